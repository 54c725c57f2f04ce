//! Maps of the motion, to look at, to repaint and to feed back (Okabe et al. 2011, §6): directions as hues
//! ([`crate::flow::orientation`]) and speeds as grey, of the picture's size.

use ndarray::Array3;

use crate::flow::field::Field;
use crate::flow::orientation;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::resample::resize;
use crate::render::recover::AssignedMotion;
use crate::scene::asked::Asked;
use crate::scene::frame_map::FrameMap;

/// Maps, and what their grey stands for.
pub struct Maps {
    /// By name: "orientation" and "speed" of the motion that was assigned; "asked-orientation" and "asked-speed" of what
    /// was asked, where something was.
    pub pictures: Vec<(&'static str, Rgb8)>,
    /// Speed at white, pixels of the picture per output frame.
    pub max_speed: f32,
}

/// Maps of the assigned motion, shown at `pace` library frames per output frame, and of what was asked. White is of the
/// speeds within `matte` (working size): pieces reach beyond it, over what does not move.
pub fn maps(motion: &AssignedMotion, pace: f32, asked: Option<&Asked>, matte: &Plane, map: &FrameMap) -> Maps {
    // How sure a direction is: the share of the motion that goes that way.
    let sure = |component: &Plane| {
        let data = component.data.iter().zip(&motion.activity.data).map(|(c, a)| if *a > 0.0 { c / a } else { 0.0 });
        Plane::from_vec(component.width, component.height, data.collect())
    };
    let sized = |plane: &Plane| resize(plane, map.picture.0, map.picture.1);
    let direction = |field: &Field| orientation::encode(&Field { u: sized(&field.u), v: sized(&field.v) });
    let speed = sized(&motion.activity.map(|v| pace * v / map.working_scale()));
    let wished = asked.map(|a| a.speed.map(|v| v.max(0.0) / map.working_scale()));
    let wished = wished.filter(|w| w.data.iter().any(|&v| v > 0.0)).map(|w| sized(&w));
    let matte = sized(matte);
    let fastest = |speed: &Plane| percentile(speed, &matte);
    let fastest = fastest(&speed).max(wished.as_ref().map_or(0.0, fastest));
    let max_speed = (fastest * 100.0).ceil().max(1.0) / 100.0;
    let mut pictures = vec![
        ("orientation", direction(&Field { u: sure(&motion.mean.u), v: sure(&motion.mean.v) })),
        ("speed", orientation::speed_picture(&speed, max_speed)),
    ];
    let any = |field: &Field| field.u.data.iter().chain(&field.v.data).any(|&v| v != 0.0);
    if let Some(asked) = asked.filter(|a| any(&a.direction)) {
        pictures.push(("asked-orientation", direction(&asked.direction)));
    }
    if let Some(wished) = &wished {
        pictures.push(("asked-speed", orientation::speed_picture(wished, max_speed)));
    }
    Maps { pictures, max_speed }
}

/// The motion that was assigned ("motion", pixels of the working image per output frame), and what was asked of it where
/// something was: "asked-direction", and "asked-speed" in the same unit, below 0 where none was asked.
pub fn arrays(motion: &Field, asked: Option<&Asked>) -> Vec<(&'static str, Array3<f32>)> {
    let mut arrays = vec![("motion", motion.to_array())];
    if let Some(asked) = asked {
        let Plane { width, height, .. } = asked.speed;
        let speed = Array3::from_shape_fn((height, width, 1), |(y, x, _)| asked.speed.at(x, y));
        arrays.extend([("asked-direction", asked.direction.to_array()), ("asked-speed", speed)]);
    }
    arrays
}

/// The 99th percentile of the values above 0 within the matte, so that one odd cell does not make all others dark; 0 when
/// there is none.
fn percentile(plane: &Plane, matte: &Plane) -> f32 {
    let inside = plane.data.iter().zip(&matte.data).filter(|(v, m)| **v > 0.0 && **m >= 0.5);
    let mut values: Vec<f32> = inside.map(|(v, _)| *v).collect();
    if values.is_empty() {
        return 0.0;
    }
    let place = (values.len() - 1) * 99 / 100;
    *values.select_nth_unstable_by(place, f32::total_cmp).1
}
