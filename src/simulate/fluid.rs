//! A simulation frame by frame.

use crate::base::error::{Error, Kind, Result};
use crate::flow::field::Field;
use crate::raster::image::{Plane, Rgb8};
use crate::simulate::file::Mode;
use crate::simulate::gas::{Budget, Smoke, total};
use crate::simulate::grid::Velocity;
use crate::simulate::preview;
use crate::simulate::setup::{MAX_WAY, Setup};
use crate::simulate::water::Shallow;

/// One frame of a designed target.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Where what is here goes until the next frame, pixels per frame; 0 in obstacles.
    pub flow: Field,
    /// Opacity in [0, 1].
    pub alpha: Plane,
    /// Depth of the water, pixels.
    pub height: Option<Plane>,
    /// For people to look at.
    pub preview: Rgb8,
}

/// What a simulation came to so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Steps made.
    pub steps: usize,
    /// Greatest divergence after projection × side of a pixel / greatest speed; 0 for water.
    pub divergence: f32,
    /// Rounds of the pressure solver, all together.
    pub rounds: usize,
    /// Greatest speed, pixels per frame.
    pub speed: f32,
}

enum State<'s> {
    Gas(Smoke<'s>),
    Water(Shallow<'s>),
}

/// A simulation under way.
pub struct Fluid<'s> {
    setup: &'s Setup,
    state: State<'s>,
    /// Number of the next frame; below 0 in the run-in.
    frame: i64,
    /// What it came to so far.
    pub tally: Tally,
}

impl<'s> Fluid<'s> {
    /// The state before the first frame and before the run-in.
    pub fn new(setup: &'s Setup) -> Self {
        let state = match setup.file.mode {
            Mode::Gas => State::Gas(Smoke::new(setup)),
            Mode::Water => State::Water(Shallow::new(setup)),
        };
        Self { setup, state, frame: -(setup.file.run_in as i64), tally: Tally::default() }
    }

    /// Simulates up to the first frame.
    ///
    /// # Errors
    /// Those of [`Fluid::next_frame`], or of `every`, which is called before every frame of the run-in.
    pub fn run_in(&mut self, mut every: impl FnMut() -> Result<()>) -> Result<()> {
        while self.frame < 0 {
            every()?;
            self.next_frame()?;
        }
        Ok(())
    }

    /// The next frame, and all the steps to the one after it.
    ///
    /// # Errors
    /// A fluid that becomes too fast for its steps, or whose pressure cannot be found.
    pub fn next_frame(&mut self) -> Result<Frame> {
        let steps = self.setup.file.steps;
        let step = 1.0 / steps as f32;
        let mut frame = None;
        for n in 0..steps {
            self.push(self.frame as f32 + n as f32 * step, step)?;
            let flow = self.velocity().centred();
            let frame = frame.get_or_insert_with(|| self.seen());
            add(&mut frame.flow, &flow, step);
            match &mut self.state {
                State::Gas(gas) => gas.carry(step),
                State::Water(water) => water.carry(step),
            }
            self.tally.steps += 1;
        }
        self.frame += 1;
        frame.ok_or_else(|| Error::new(Kind::Usage, "steps", "0 is out of range"))
    }

    /// Where the density, or the water, went; and how much there is.
    pub fn budget(&self) -> (Budget, f64) {
        match &self.state {
            State::Gas(gas) => (gas.budget, total(&gas.density)),
            State::Water(water) => (water.budget, total(&water.depth)),
        }
    }

    fn velocity(&self) -> &Velocity {
        match &self.state {
            State::Gas(gas) => &gas.velocity,
            State::Water(water) => &water.velocity,
        }
    }

    /// Emitters and forces, and whether what they made can be carried.
    fn push(&mut self, frame: f32, step: f32) -> Result<()> {
        match &mut self.state {
            State::Gas(gas) => {
                let done = gas.push(frame, step)?;
                self.tally.divergence = self.tally.divergence.max(done.divergence);
                self.tally.rounds += done.rounds;
            }
            State::Water(water) => water.push(frame, step),
        }
        let speed = self.velocity().greatest();
        self.tally.speed = self.tally.speed.max(speed);
        if speed * step <= MAX_WAY {
            return Ok(());
        }
        let when = if self.frame < 0 {
            format!("{} frames before the first", -self.frame)
        } else {
            format!("at frame {}", self.frame)
        };
        let problem = format!("{when} it moves {:.1} pixels in one step", speed * step);
        Err(Error::new(Kind::Usage, "steps", problem)
            .allowed(format!("up to {MAX_WAY}"))
            .remedy("give more steps a frame, or gentler forces and emitters"))
    }

    /// The frame as it is now, its flow still to come.
    fn seen(&self) -> Frame {
        let solid = &self.setup.domain.solid;
        let (alpha, height, preview) = match &self.state {
            State::Gas(gas) => (gas.alpha(), None, preview::gas(&gas.alpha(), &gas.temperature, solid)),
            State::Water(water) => {
                let preview = preview::water(&water.depth, self.setup.water.depth, &water.foam, solid);
                (water.alpha(), Some(water.depth.clone()), preview)
            }
        };
        Frame { flow: Field::zeros(alpha.width, alpha.height), alpha, height, preview }
    }
}

fn add(to: &mut Field, flow: &Field, weight: f32) {
    for (to, from) in [(&mut to.u, &flow.u), (&mut to.v, &flow.v)] {
        to.data.iter_mut().zip(&from.data).for_each(|(t, f)| *t += weight * f);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::par;
    use crate::simulate::file::parse;
    use crate::simulate::grid::greatest;
    use std::path::Path;

    fn setup(text: &str) -> Setup {
        Setup::new(parse(text, Path::new("sim.toml")).unwrap(), Path::new("")).unwrap()
    }

    fn frames(setup: &Setup) -> (Vec<Frame>, Tally, f64) {
        let mut fluid = Fluid::new(setup);
        let frames = (0..setup.file.frames).map(|_| fluid.next_frame().unwrap()).collect();
        let (budget, now) = fluid.budget();
        (frames, fluid.tally, (budget.given - budget.left - budget.faded - now).abs() / budget.given)
    }

    const PLUME: &str = "size = [64, 96]\nframes = 90\nvorticity = 0.1\n[gas]\nbuoyancy = 0.2\n\
                         [[emitter]]\ndisc = [32, 84, 7]\nrate = 0.2\ntemperature = 1\n";

    #[test]
    fn still_fluids_stay_still() {
        for mode in ["gas", "water"] {
            let (frames, _, _) = frames(&setup(&format!("mode = '{mode}'\nsize = [32, 24]\nframes = 20\n")));
            let last = &frames[19];
            assert_eq!((greatest(&last.flow.u.data), greatest(&last.flow.v.data)), (0.0, 0.0));
        }
    }

    #[test]
    fn even_heat_and_weight_move_nothing() {
        let text = "size = [32, 24]\nframes = 20\n[gas]\nweight = 0.2\n[[emitter]]\nbox = [-9, -9, 99, 99]\n\
                    temperature = 1\nrate = 0.5\nuntil = 1\n";
        let last = frames(&setup(text)).0.pop().unwrap();
        assert!(greatest(&last.flow.u.data).max(greatest(&last.flow.v.data)) < 1e-3);
    }

    #[test]
    fn a_plume_rises_keeps_its_mass_and_is_free_of_divergence() {
        let (frames, tally, drift) = frames(&setup(PLUME));
        let height = |frame: &Frame| {
            let rows = (0..96).map(|y| (y as f32, frame.alpha.row(y).iter().sum::<f32>()));
            let (sum, mass) = rows.fold((0.0, 0.0), |(s, m), (y, row)| (s + y * row, m + row));
            sum / mass
        };
        assert!(height(&frames[89]) < height(&frames[20]) - 15.0);
        assert!(tally.divergence <= 1e-4 && drift <= 1e-5, "{tally:?} {drift}");
    }

    #[test]
    fn a_symmetric_plume_stays_symmetric_and_smooth() {
        let (frames, _, _) = frames(&setup(PLUME));
        let last = &frames[60];
        let (mut uneven, mut checked, mut range) = (0.0f32, 0.0f32, 0.0f32);
        for y in 1..95 {
            for x in 1..63 {
                uneven = uneven.max((last.alpha.at(x, y) - last.alpha.at(63 - x, y)).abs());
                // What a checkerboard would have: the fourth difference across both directions.
                let v = |dx: usize, dy: usize| last.flow.v.at(x + dx - 1, y + dy - 1);
                let cross = (v(0, 0) + v(2, 2) + v(0, 2) + v(2, 0)) - 2.0 * (v(1, 0) + v(1, 2) + v(0, 1) + v(2, 1));
                checked += (cross + 4.0 * v(1, 1)).powi(2);
                range += v(1, 1).powi(2);
            }
        }
        assert!(uneven < 0.02, "{uneven}");
        assert!(checked < 0.02 * 16.0 * range, "{checked} of {range}");
    }

    #[test]
    fn the_flow_tells_where_the_smoke_goes() {
        let (frames, _, _) = frames(&setup(PLUME));
        let (now, next) = (&frames[60], &frames[61]);
        // The emitter adds smoke of its own; above it the smoke is only carried along.
        let (mut carried, mut still) = (0.0, 0.0);
        for y in 8..70 {
            for x in 4..60 {
                let place = |f: f32, at: usize| at as f32 + 0.5 - f;
                let from = now.alpha.bilinear(place(now.flow.u.at(x, y), x), place(now.flow.v.at(x, y), y));
                carried += (next.alpha.at(x, y) - from).powi(2);
                still += (next.alpha.at(x, y) - now.alpha.at(x, y)).powi(2);
            }
        }
        assert!(carried < 0.1 * still, "{carried} against {still}");
    }

    #[test]
    fn a_taylor_green_vortex_decays_slowly() {
        let setup = setup("size = [64, 64]\nframes = 64\n");
        let mut fluid = Fluid::new(&setup);
        let wave = std::f32::consts::PI / 64.0;
        let State::Gas(gas) = &mut fluid.state else { unreachable!() };
        gas.velocity.u = Plane::from_fn(65, 64, |x, y| (wave * x as f32).sin() * (wave * (y as f32 + 0.5)).cos());
        gas.velocity.v = Plane::from_fn(64, 65, |x, y| -(wave * (x as f32 + 0.5)).cos() * (wave * y as f32).sin());
        let energy = |v: &Velocity| v.u.data.iter().chain(&v.v.data).map(|v| v * v).sum::<f32>();
        let before = energy(&gas.velocity);
        (0..64).for_each(|_| drop(fluid.next_frame().unwrap()));
        let kept = energy(fluid.velocity()) / before;
        assert!((0.92..1.001).contains(&kept), "{kept}");
    }

    #[test]
    fn a_wave_travels_at_its_speed_and_its_surface_has_divergence() {
        let text = "mode = 'water'\nsize = [160, 16]\nframes = 30\n[water]\ndepth = 10\ngravity = 0.4\ndamping = 0.01\n\
                    [[emitter]]\nbox = [0, 0, 12, 16]\nrate = 0.5\nuntil = 1\n";
        let (frames, _, drift) = frames(&setup(text));
        let front = |frame: &Frame| {
            let row = frame.height.as_ref().unwrap().row(8);
            (0..160).max_by(|&a, &b| row[a].total_cmp(&row[b])).unwrap() as f32
        };
        let speed = (front(&frames[29]) - front(&frames[9])) / 20.0;
        assert!((speed - 2.0).abs() < 0.15, "{speed}");
        let flow = &frames[20].flow;
        let spread = (1..159).map(|x| (flow.u.at(x + 1, 8) - flow.u.at(x - 1, 8)).abs()).fold(0.0, f32::max);
        assert!(spread > 1e-3 && drift < 1e-6, "{spread} {drift}");
    }

    #[test]
    fn frames_are_the_same_on_any_number_of_threads() {
        for mode in ["gas", "water"] {
            let text = format!(
                "mode = '{mode}'\nsize = [200, 190]\nframes = 3\nvorticity = 0.1\n\
                                [[emitter]]\ndisc = [100, 90, 20]\nrate = 0.5\nvelocity = [1, -1]\nflicker = 0.5\n"
            );
            let setup = setup(&text);
            let run = |threads: usize| par::with_threads(threads, || frames(&setup).0).unwrap();
            assert!(run(1) == run(3));
        }
    }
}
