//! Exemplars as they were filmed, for methods that look at how a fluid moves: every frame in order, at its own size, neither
//! looped nor multiplied by its opacity, with the motion and the parameters that go with it.

use super::files::no_room;
use super::opacity::{Opacity, Shot};
use super::shots::{Pair, Shots};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::flow::field::Field;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::picture_io::read_picture;
use crate::scene::exemplar::{Shape, check_count, open_moving, same_size};
use crate::scene::exemplar_file::ExemplarFile;
use crate::scene::flow_files::FlowFiles;
use crate::scene::parameters::Parameters;
use crate::scene::scene::Scene;
use crate::synth::memory;
use crate::video::clip::{Pixels, RawFrame};
use crate::video::conform::scale::to_rgb8;
use crate::video::conform::turned;

/// All frames of an exemplar.
#[derive(Debug, Clone, PartialEq)]
pub struct ExemplarVideo {
    frames: Vec<Frame>,
    /// Frames per second as filmed; none of a picture, or where the file does not tell.
    pub rate: Option<f64>,
    flow: Option<FlowFiles>,
    parameters: Option<Known>,
}

/// A frame as bytes.
#[derive(Debug, Clone, PartialEq)]
struct Frame {
    colours: Rgb8,
    /// One value a pixel; none: opaque all over.
    opacity: Option<Vec<u8>>,
}

/// Parameters that are read when they are needed, or those of a clip, which cannot be.
#[derive(Debug, Clone, PartialEq)]
enum Known {
    Files(Parameters),
    Read(Vec<Plane>),
}

impl ExemplarVideo {
    /// All exemplars of a scene.
    ///
    /// # Errors
    /// A scene without any; files that cannot be read or do not belong together; more than the memory that is allowed; a
    /// cancel.
    pub fn all(scene: &Scene, observer: &dyn Observer) -> Result<Vec<Self>> {
        let files = &scene.settings().exemplars;
        if files.is_empty() {
            return Err(Error::new(Kind::Usage, "exemplar", "none is named, and this method borrows from one")
                .remedy("name a clip whose looks and motion are borrowed, with --exemplar"));
        }
        let (mut all, mut taken) = (Vec::with_capacity(files.len()), 0);
        for file in files {
            let video = Self::read(file, memory::room(scene, taken)?, observer)?;
            taken += video.bytes();
            all.push(video);
        }
        Ok(all)
    }

    /// Reads an exemplar into at most `room` bytes, where there is a limit.
    ///
    /// # Errors
    /// Those of [`ExemplarVideo::all`].
    pub fn read(file: &ExemplarFile, room: Option<u64>, observer: &dyn Observer) -> Result<Self> {
        let (frames, rate) = match Shots::open(file)? {
            None => {
                let shot = Shot::of_picture(read_picture(&file.frames)?);
                let alpha = Opacity::of(file)?.alpha(&shot)?;
                (vec![Frame::new(shot.colours, &alpha)], None)
            }
            Some(shots) => frames(shots, room, observer)?,
        };
        let flow = file.flow.as_deref().map(FlowFiles::open).transpose()?;
        let mut video = Self { frames, rate, flow, parameters: None };
        let (count, size) = (video.frames(), video.size());
        if let Some((flow, folder)) = video.flow.as_ref().zip(file.flow.as_ref()) {
            same_size(&flow.files.files[0], flow.size, size)?;
            check_count(folder, Some(flow.files.frames()), Some(count), true)?;
        }
        let left = room.map(|room| room.saturating_sub(video.bytes()));
        video.parameters = parameters(file, size, count, left, observer)?;
        Ok(video)
    }

    /// Number of frames; 1 of a picture.
    pub fn frames(&self) -> usize {
        self.frames.len()
    }

    /// Width and height of every frame, pixels.
    pub fn size(&self) -> (usize, usize) {
        let colours = &self.frames[0].colours;
        (colours.width, colours.height)
    }

    /// The colours of frame `t` as the file has them: footage on black or white with what is behind it, a file with its
    /// own opacity not multiplied by that.
    pub fn colours(&self, t: usize) -> &Rgb8 {
        &self.frames[t].colours
    }

    /// Opacity of frame `t`, in [0, 1].
    pub fn opacity(&self, t: usize) -> Plane {
        let (width, height) = self.size();
        match &self.frames[t].opacity {
            None => Plane::filled(width, height, 1.0),
            Some(bytes) => Plane::from_vec(width, height, bytes.iter().map(|byte| f32::from(*byte) / 255.0).collect()),
        }
    }

    /// Motion that led from frame `t − 1` to frame `t`, as that of a target; none where none is given.
    ///
    /// # Errors
    /// An unreadable file; a vector that is unknown, or longer than the picture.
    pub fn flow(&self, t: usize) -> Result<Option<Field>> {
        self.flow.as_ref().map(|flow| flow.leading_to(t, self.frames())).transpose()
    }

    /// Parameters at frame `t`, components in [0, 1]; none where none are given.
    ///
    /// # Errors
    /// An unreadable file; what is not a number or outside [0, 1].
    pub fn parameters(&self, t: usize) -> Result<Option<Vec<Plane>>> {
        match &self.parameters {
            None => Ok(None),
            Some(Known::Files(files)) => files.at(t).map(Some),
            Some(Known::Read(planes)) => Ok(Some(vec![planes[t].clone()])),
        }
    }

    /// Memory that it takes, bytes.
    pub fn bytes(&self) -> u64 {
        let read = match &self.parameters {
            Some(Known::Read(planes)) => planes.iter().map(|plane| size_of_val(&plane.data[..])).sum(),
            Some(Known::Files(_)) | None => 0,
        };
        (self.frames.iter().map(Frame::bytes).sum::<usize>() + read) as u64
    }
}

impl Frame {
    fn new(colours: Rgb8, alpha: &Plane) -> Self {
        let opaque = alpha.data.iter().all(|a| *a >= 1.0);
        let byte = |a: &f32| (a.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        Self { colours, opacity: (!opaque).then(|| alpha.data.iter().map(byte).collect()) }
    }

    fn bytes(&self) -> usize {
        self.colours.data.len() + self.opacity.as_ref().map_or(0, Vec::len)
    }
}

/// All frames of a clip, and its rate.
fn frames(mut shots: Shots, room: Option<u64>, observer: &dyn Observer) -> Result<(Vec<Frame>, Option<f64>)> {
    let (mut frames, mut taken, mut times): (Vec<Frame>, u64, Vec<u64>) = (Vec::new(), 0, Vec::new());
    while let Some(pair) = shots.next_pair()? {
        observe::check(observer)?;
        times.push(pair.frame.time_ns);
        let frame = frame(&shots, &pair)?;
        taken += frame.bytes() as u64;
        if let Some(room) = room.filter(|&room| taken > room) {
            return Err(no_room(shots.path, room));
        }
        frames.push(frame);
    }
    let span = times.last().map_or(0, |last| last - times[0]);
    let rate = (span > 0).then(|| (times.len() - 1) as f64 * 1e9 / span as f64);
    match frames.is_empty() {
        true => Err(Error::file(Kind::Data, shots.path, "the clip has no frame").remedy("check that it plays")),
        false => Ok((frames, rate)),
    }
}

fn frame(shots: &Shots, pair: &Pair) -> Result<Frame> {
    let shot = shots.shot(pair);
    let alpha = shots.opacity.alpha(&shot)?;
    let own = matches!(shots.opacity, Opacity::Own).then(|| straight(&pair.frame)).flatten();
    Ok(Frame::new(own.unwrap_or(shot.colours), &alpha))
}

/// The colours of a frame with opacity, not multiplied by it.
fn straight(frame: &RawFrame) -> Option<Rgb8> {
    let Pixels::Rgba(pixels) = &frame.pixels else { return None };
    let data = pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    Some(Rgb8 { width: frame.width, height: frame.height, data })
}

/// The parameters of an exemplar of `count` frames.
fn parameters(
    file: &ExemplarFile,
    size: (usize, usize),
    count: usize,
    room: Option<u64>,
    observer: &dyn Observer,
) -> Result<Option<Known>> {
    let Some(path) = file.parameters.as_deref() else { return Ok(None) };
    let clip = if Shape::of_moving(path)?.is_some() { open_moving(path)? } else { None };
    let Some(mut clip) = clip else {
        let parameters = Parameters::of(path)?;
        parameters.sizes()?.into_iter().try_for_each(|(file, found)| same_size(file, found, size))?;
        let frames = parameters.frames()?;
        if frames > 1 {
            check_count(path, Some(frames), Some(count), false)?;
        }
        return Ok(Some(Known::Files(parameters)));
    };
    let mut planes: Vec<Plane> = Vec::new();
    while let Some(frame) = clip.next_frame()? {
        observe::check(observer)?;
        let plane = turned(to_rgb8(&frame), clip.info().turn).luma();
        same_size(path, (plane.width, plane.height), size)?;
        planes.push(plane);
        let taken = (planes.len() * size.0 * size.1 * size_of::<f32>()) as u64;
        if let Some(room) = room.filter(|&room| taken > room) {
            return Err(no_room(path, room));
        }
    }
    check_count(path, Some(planes.len()), Some(count), false)?;
    Ok(Some(Known::Read(planes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;
    use crate::flow::io;
    use crate::raster::npy;
    use crate::raster::picture_io::{encode_rgba_png, write_grey_png, write_png};
    use crate::scene::exemplar_file::Opacity as Given;
    use ndarray::{Array3, Array4};
    use std::path::Path;

    const SIZE: (usize, usize) = (12, 9);

    /// Five frames, frame `t` of brightness `40 t`, with a mask whose column `t` is opaque.
    fn clip(folder: &Path) -> ExemplarFile {
        for name in ["clip", "alpha", "flow"] {
            std::fs::create_dir_all(folder.join(name)).unwrap();
        }
        for t in 0..5 {
            let colours = Rgb8 { width: SIZE.0, height: SIZE.1, data: vec![40 * t as u8; SIZE.0 * SIZE.1 * 3] };
            write_png(&folder.join(format!("clip/{t}.png")), &colours).unwrap();
            let alpha = Plane::from_fn(SIZE.0, SIZE.1, |x, _| f32::from(x == t));
            write_grey_png(&folder.join(format!("alpha/{t}.png")), &alpha).unwrap();
        }
        ExemplarFile { opacity: Some(Given::File(folder.join("alpha"))), ..ExemplarFile::new(folder.join("clip")) }
    }

    fn flow(folder: &Path, files: usize) {
        for t in 0..files {
            let field = Field { u: Plane::filled(SIZE.0, SIZE.1, t as f32), v: Plane::zeros(SIZE.0, SIZE.1) };
            io::write(&folder.join(format!("flow/{t}.flo")), &field).unwrap();
        }
    }

    fn read(file: &ExemplarFile) -> Result<ExemplarVideo> {
        ExemplarVideo::read(file, None, &Silent)
    }

    #[test]
    fn all_frames_come_in_order_as_they_were_filmed() {
        let folder = tempfile::tempdir().unwrap();
        let video = read(&clip(folder.path())).unwrap();
        assert_eq!((video.frames(), video.size(), video.rate), (5, SIZE, Some(25.0)));
        for t in 0..5 {
            assert_eq!(video.colours(t).data, vec![40 * t as u8; SIZE.0 * SIZE.1 * 3], "not multiplied");
            assert_eq!((0..6).map(|x| video.opacity(t).at(x, 4)).position(|a| a == 1.0), Some(t));
        }
        assert_eq!(video.bytes(), 5 * 4 * (SIZE.0 * SIZE.1) as u64);
        assert_eq!((video.flow(2).unwrap(), video.parameters(2).unwrap()), (None, None));
        let error = ExemplarVideo::read(&clip(folder.path()), Some(1000), &Silent).unwrap_err();
        assert_eq!(error.kind(), Kind::Limit);
    }

    #[test]
    fn a_files_own_opacity_does_not_darken_its_colours() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("clip")).unwrap();
        for name in ["clip/0.png", "clip/1.png", "one.png"] {
            let data = [200, 100, 50, 128, 200, 100, 50, 255];
            let bytes = encode_rgba_png((2, 1), &data, png::Compression::Fast).unwrap();
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        for (name, frames) in [("clip", 2), ("one.png", 1)] {
            let video = read(&ExemplarFile::new(folder.path().join(name))).unwrap();
            assert_eq!((video.frames(), video.colours(0).pixel(0, 0)), (frames, [200, 100, 50]));
            assert_eq!(video.opacity(frames - 1).data, [128.0 / 255.0, 1.0]);
        }
    }

    #[test]
    fn flow_has_a_file_for_every_frame_or_every_step() {
        let folder = tempfile::tempdir().unwrap();
        let file = ExemplarFile { flow: Some(folder.path().join("flow")), ..clip(folder.path()) };
        let right = |video: &ExemplarVideo, t| video.flow(t).unwrap().unwrap().u.at(3, 3);
        for files in [4, 5] {
            flow(folder.path(), files);
            let video = read(&file).unwrap();
            assert_eq!([0, 1, 2, 4].map(|t| right(&video, t)), [0.0, 0.0, 1.0, 3.0]);
        }
        flow(folder.path(), 6);
        let error = read(&file).unwrap_err().to_string();
        assert!(error.contains("has 6 frames, the exemplar has 5 frames (allowed: 4 or 5"), "{error}");
    }

    #[test]
    fn parameters_are_pictures_or_arrays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.npy");
        let file = ExemplarFile { parameters: Some(path.clone()), ..clip(folder.path()) };
        let all = Array4::from_shape_fn((5, SIZE.1, SIZE.0, 3), |(t, _, _, c)| t as f32 / 10.0 + c as f32 / 100.0);
        npy::write_array(&path, all.view()).unwrap();
        let at = |file: &ExemplarFile, t| read(file).unwrap().parameters(t).unwrap().unwrap();
        let planes = at(&file, 4);
        assert_eq!((planes.len(), planes[2].at(11, 8)), (3, 0.4 + 0.02));
        npy::write_array(&path, Array3::from_elem((SIZE.1, SIZE.0, 1), 51u8).view()).unwrap();
        assert_eq!(at(&file, 3)[0].at(0, 0), 0.2, "one serves all");
        let masks = ExemplarFile { parameters: Some(folder.path().join("alpha")), ..file.clone() };
        assert_eq!((at(&masks, 3)[0].at(3, 0), at(&masks, 3)[0].at(2, 0)), (1.0, 0.0));
        let picture = ExemplarFile { parameters: Some(folder.path().join("alpha/2.png")), ..file.clone() };
        assert_eq!(at(&picture, 4)[0].at(2, 0), 1.0);
        npy::write_array(&path, Array4::from_elem((5, SIZE.1, SIZE.0, 1), f32::NAN).view()).unwrap();
        let error = read(&file).unwrap().parameters(1).unwrap_err().to_string();
        assert!(error.contains("p.npy") && error.contains("not a number"), "{error}");
        npy::write_array(&path, Array4::<f32>::zeros((4, SIZE.1, SIZE.0, 1)).view()).unwrap();
        assert!(read(&file).unwrap_err().to_string().contains("has 4 frames, the exemplar has 5 frames"));
    }
}
