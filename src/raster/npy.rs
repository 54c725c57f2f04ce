//! Arrays of numbers in NumPy's `.npy` files: frames and maps that Python made, and what a run hands to Python.
//!
//! A file is `\x93NUMPY`, a version, a header that is a Python dictionary (element type, order of the axes, shape) and
//! the elements. Read are frames `(t, y, x, channel)`, one frame `(y, x, channel)` or a map `(y, x)`, of the types
//! `uint8` (0 to 255 mean 0 to 1), `float32` and `float64` (0 to 1), in C or Fortran order. Nothing of the size that a
//! header tells is allocated before the file is known to hold it.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use bytemuck::NoUninit;
use memmap2::Mmap;
use ndarray::{Array3, Array4, ArrayView, ArrayView4, Axis, Dimension, ShapeBuilder};

use super::image::Plane;
use super::picture_io::{MAX_PIXELS, MAX_SIDE};
use crate::base::atomic_file::AtomicFile;
use crate::base::error::{Error, Kind, Result};

/// First bytes of a file.
const MAGIC: &[u8] = b"\x93NUMPY";
/// Longest header that is read, bytes; NumPy's own are of a hundred.
const MAX_HEADER: usize = 1 << 16;
/// Most frames of an array that is read.
pub const MAX_FRAMES: usize = 100_000;
/// Most channels of an array that is read; more are hardly channels but an axis of pixels.
pub const MAX_CHANNELS: usize = 64;
/// Most values that [`read_array`] takes into memory (4 GiB).
pub const MAX_VALUES: usize = 1 << 30;
/// Shapes that are read, for messages.
const SHAPES: &str = "(t, y, x, channel), (y, x, channel) or (y, x)";

/// Type of the elements of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Number {
    U8,
    F32,
    F64,
}

impl Number {
    fn of(name: &str) -> Option<Self> {
        match name {
            "|u1" | "<u1" => Some(Self::U8),
            "<f4" => Some(Self::F32),
            "<f8" => Some(Self::F64),
            _ => None,
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// What the header of a file tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Header {
    number: Number,
    /// Whether the first axis runs fastest.
    fortran: bool,
    /// Frames, rows, columns, channels.
    shape: [usize; 4],
    /// Bytes before the first element.
    start: usize,
}

/// An open file of frames, from which one after the other can be taken: the file is mapped, not read at once.
#[derive(Debug)]
pub struct Frames {
    path: PathBuf,
    map: Mmap,
    header: Header,
}

impl Frames {
    /// Opens a file and checks all but its values.
    ///
    /// # Errors
    /// A missing file; one that is no `.npy` file, is damaged, is shorter or longer than its shape asks; a type or shape
    /// that is not read (see the module); no pixels, or more than [`MAX_PIXELS`] in a frame, [`MAX_SIDE`] a side,
    /// [`MAX_FRAMES`] or [`MAX_CHANNELS`].
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
        let length = file.metadata().map_err(|e| Error::io(path, "read", e))?.len();
        if length == 0 {
            return Err(foreign(path));
        }
        // SAFETY: the map is only read, as bytes. That nobody shortens the file meanwhile is asked of users, as for
        // libraries.
        let map = unsafe { Mmap::map(&file) }.map_err(|e| Error::io(path, "map", e))?;
        let header = Header::parse(&map, path)?;
        Ok(Self { path: path.to_owned(), map, header })
    }

    /// Frames, rows, columns, channels.
    pub fn shape(&self) -> [usize; 4] {
        self.header.shape
    }

    /// Frame `t`: rows, columns, channels, values in [0, 1], in C order.
    ///
    /// # Errors
    /// A value that is not a number or outside 0 to 1, with its place.
    ///
    /// # Panics
    /// When there is no frame `t`.
    pub fn frame(&self, t: usize) -> Result<Array3<f32>> {
        let frame = match self.header.number {
            Number::U8 => self.values(t, |[v]: [u8; 1]| f32::from(v) / 255.0),
            Number::F32 => self.values(t, f32::from_le_bytes),
            Number::F64 => self.values(t, |v| f64::from_le_bytes(v) as f32),
        };
        match frame.indexed_iter().find(|(_, v)| !(0.0..=1.0).contains(*v)) {
            None => Ok(frame),
            Some(((y, x, channel), value)) => {
                let what = if value.is_nan() { "what is not a number".to_owned() } else { value.to_string() };
                let problem = format!("holds {what} in frame {t} at row {y}, column {x}, channel {channel}");
                Err(Error::file(Kind::Data, &self.path, problem)
                    .allowed("0 to 1, or uint8 of 0 to 255")
                    .remedy("bring the values to 0 to 1, or save them with .astype(\"uint8\")"))
            }
        }
    }

    /// Frame `t` of elements of `N` bytes.
    fn values<const N: usize>(&self, t: usize, value: impl Fn([u8; N]) -> f32) -> Array3<f32> {
        let Header { shape, fortran, start, .. } = self.header;
        let elements = self.map[start..].as_chunks().0;
        let all = ArrayView4::from_shape(shape.set_f(fortran), elements).expect("the length was checked");
        let frame = all.index_axis(Axis(0), t);
        let values = frame.iter().map(|&bytes| value(bytes)).collect();
        Array3::from_shape_vec(frame.raw_dim(), values).expect("as many values as the frame has")
    }
}

/// Reads all frames of a file: frames, rows, columns, channels, values in [0, 1], in C order. A single frame is one of a
/// video of one, and a map `(y, x)` has one channel.
///
/// # Errors
/// Those of [`Frames::open`] and [`Frames::frame`]; more than [`MAX_VALUES`] values.
pub fn read_array(path: &Path) -> Result<Array4<f32>> {
    let frames = Frames::open(path)?;
    let shape = frames.shape();
    if shape.iter().product::<usize>() > MAX_VALUES {
        let problem = format!("{} values are too many to hold at once", shape.iter().product::<usize>());
        return Err(Error::file(Kind::Limit, path, problem)
            .allowed(format!("up to {MAX_VALUES}"))
            .remedy("give fewer or smaller frames"));
    }
    let mut all = Array4::zeros(shape);
    for (t, mut frame) in all.outer_iter_mut().enumerate() {
        frame.assign(&frames.frame(t)?);
    }
    Ok(all)
}

/// The channels of a frame as planes.
pub fn planes(frame: &Array3<f32>) -> Vec<Plane> {
    let (height, width, _) = frame.dim();
    frame.axis_iter(Axis(2)).map(|c| Plane::from_vec(width, height, c.iter().copied().collect())).collect()
}

impl Header {
    /// Reads and checks the header of a whole file.
    fn parse(bytes: &[u8], path: &Path) -> Result<Self> {
        let (text, start) = dictionary(bytes, path)?;
        let unreadable = |what: &str| {
            Error::file(Kind::Data, path, format!("its header does not tell {what}")).remedy("write it with numpy.save")
        };
        let name = type_of(text).ok_or_else(|| unreadable("the type of the numbers"))?;
        let number = Number::of(name).ok_or_else(|| {
            Error::file(Kind::Unsupported, path, format!("holds elements of the type {name:?}"))
                .allowed("uint8, float32 or float64, little-endian")
                .remedy("save it with .astype(\"float32\")")
        })?;
        let fortran = match value_of(text, "fortran_order") {
            Some(value) if value.starts_with("False") => false,
            Some(value) if value.starts_with("True") => true,
            _ => return Err(unreadable("the order of the axes")),
        };
        let axes = shape_of(text).ok_or_else(|| unreadable("the shape"))?;
        let shape = frames_of(&axes, path)?;
        let header = Self { number, fortran, shape, start };
        header.check_length(bytes.len(), path)?;
        Ok(header)
    }

    /// Refuses a file that holds more or less than its shape asks.
    fn check_length(&self, length: usize, path: &Path) -> Result<()> {
        // Within the limits on every axis this does not overflow.
        let wanted = self.shape.iter().map(|&n| n as u128).product::<u128>() * self.number.bytes() as u128;
        let found = (length - self.start) as u128;
        if found == wanted {
            return Ok(());
        }
        let fault = if found < wanted { "is truncated" } else { "is longer than its shape" };
        let [frames, height, width, channels] = self.shape;
        let problem =
            format!("{fault}: {frames} × {height} × {width} × {channels} elements need {wanted} bytes, it has {found}");
        Err(Error::file(Kind::Data, path, problem).remedy("write it again"))
    }
}

fn foreign(path: &Path) -> Error {
    Error::file(Kind::Data, path, "is not an .npy file").remedy("write it with numpy.save")
}

/// The dictionary of the header as text, and where the elements begin.
fn dictionary<'a>(bytes: &'a [u8], path: &Path) -> Result<(&'a str, usize)> {
    let rest = bytes.strip_prefix(MAGIC).filter(|rest| rest.len() >= 4).ok_or_else(|| foreign(path))?;
    let (length, from) = match (rest[0], rest.len()) {
        (1, _) => (usize::from(u16::from_le_bytes([rest[2], rest[3]])), 4),
        (2 | 3, 6..) => (u32::from_le_bytes([rest[2], rest[3], rest[4], rest[5]]) as usize, 6),
        (version, _) => {
            return Err(Error::file(Kind::Unsupported, path, format!("is of version {version} of the format"))
                .allowed("1 to 3")
                .remedy("write it with numpy.save"));
        }
    };
    let text = rest[from..].get(..length).filter(|_| length <= MAX_HEADER);
    let text = text.and_then(|text| std::str::from_utf8(text).ok());
    let text = text.ok_or_else(|| Error::file(Kind::Data, path, "its header is damaged").remedy("write it again"))?;
    Ok((text, MAGIC.len() + from + length))
}

/// What follows a key of the dictionary.
fn value_of<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let after = |quote: char| text.split_once(&format!("{quote}{key}{quote}"));
    let (_, rest) = after('\'').or_else(|| after('"'))?;
    Some(rest.trim_start().strip_prefix(':')?.trim_start())
}

/// The type of the elements, without the quotes; "structure" where it is no string but a list of fields.
fn type_of(text: &str) -> Option<&str> {
    let value = value_of(text, "descr")?;
    match value.chars().next()? {
        quote @ ('\'' | '"') => value[1..].split(quote).next(),
        _ => Some("structure"),
    }
}

/// The lengths of the axes.
fn shape_of(text: &str) -> Option<Vec<usize>> {
    let (inside, _) = value_of(text, "shape")?.strip_prefix('(')?.split_once(')')?;
    inside.split(',').map(str::trim).filter(|n| !n.is_empty()).map(|n| n.parse().ok()).collect()
}

/// The axes of a file as frames, rows, columns, channels.
fn frames_of(axes: &[usize], path: &Path) -> Result<[usize; 4]> {
    let shape = match *axes {
        [height, width] => [1, height, width, 1],
        [height, width, channels] => [1, height, width, channels],
        [frames, height, width, channels] => [frames, height, width, channels],
        _ => {
            let axes = if axes.len() == 1 { "1 axis".to_owned() } else { format!("{} axes", axes.len()) };
            return Err(Error::file(Kind::Data, path, format!("has {axes}")).allowed(SHAPES));
        }
    };
    let [frames, height, width, channels] = shape;
    let side = 1..=MAX_SIDE as usize;
    let fits = (1..=MAX_FRAMES).contains(&frames) && side.contains(&height) && side.contains(&width);
    if fits && (1..=MAX_CHANNELS).contains(&channels) && (width * height) as u64 <= MAX_PIXELS {
        return Ok(shape);
    }
    let listed: Vec<String> = axes.iter().map(usize::to_string).collect();
    let megapixels = MAX_PIXELS / 1_000_000;
    let error = Error::file(Kind::Limit, path, format!("its shape is ({})", listed.join(", "))).allowed(format!(
        "{SHAPES}, with 1 to {MAX_SIDE} pixels a side, up to {megapixels} megapixels, {MAX_CHANNELS} channels and \
         {MAX_FRAMES} frames"
    ));
    Err(match axes.len() {
        3 => error.remedy("give grey frames (t, y, x) a last axis: a[..., None]"),
        _ => error,
    })
}

/// What can be an element of a file that is written.
pub trait Element: NoUninit {
    /// Its type as the header says it, in Python.
    const TYPE: &'static str;
}

impl Element for u8 {
    const TYPE: &'static str = "'|u1'";
}

impl Element for i32 {
    const TYPE: &'static str = "'<i4'";
}

impl Element for f32 {
    const TYPE: &'static str = "'<f4'";
}

/// Writes an array piece by piece along its first axis, whose length the header gets at the end.
#[derive(Debug)]
pub struct Writer<T> {
    file: BufWriter<AtomicFile>,
    path: PathBuf,
    /// Lengths of the axes after the first.
    inner: Vec<usize>,
    elements: usize,
    of: PhantomData<T>,
}

impl<T: Element> Writer<T> {
    /// Opens a file whose axes after the first have the lengths `inner`; it appears under its name when it is finished.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn create(path: &Path, inner: &[usize]) -> Result<Self> {
        let file = BufWriter::new(AtomicFile::create(path)?);
        let mut writer = Self { file, path: path.to_owned(), inner: inner.to_vec(), elements: 0, of: PhantomData };
        let header = header(T::TYPE, 0, inner);
        writer.file.write_all(&header).map_err(|e| Error::io(path, "write", e))?;
        Ok(writer)
    }

    /// Adds elements, the last axis fastest.
    ///
    /// # Errors
    /// A full disk.
    pub fn push(&mut self, elements: &[T]) -> Result<()> {
        self.elements += elements.len();
        self.file.write_all(bytemuck::cast_slice(elements)).map_err(|e| Error::io(&self.path, "write", e))
    }

    /// Completes the header and gives the file its name.
    ///
    /// # Errors
    /// A full disk; elements that are no whole number of steps along the first axis.
    pub fn finish(self) -> Result<()> {
        let step: usize = self.inner.iter().product();
        if step == 0 || !self.elements.is_multiple_of(step) {
            let problem = format!("{} elements are no whole number of steps of {step}", self.elements);
            return Err(Error::file(Kind::Data, &self.path, problem));
        }
        let header = header(T::TYPE, self.elements / step, &self.inner);
        let refused = |e| Error::io(&self.path, "write", e);
        let mut file = self.file.into_inner().map_err(|e| refused(e.into_error()))?;
        file.seek(SeekFrom::Start(0)).and_then(|_| file.write_all(&header)).map_err(refused)?;
        file.commit()
    }
}

/// Writes a whole array.
///
/// # Errors
/// Those of [`Writer`]; an array without axes.
pub fn write_array<T: Element, D: Dimension>(path: &Path, array: ArrayView<T, D>) -> Result<()> {
    let Some((_, inner)) = array.shape().split_first() else {
        return Err(Error::file(Kind::Data, path, "an array without axes is not written"));
    };
    let mut writer = Writer::create(path, inner)?;
    match array.as_slice() {
        Some(elements) => writer.push(elements)?,
        None => writer.push(&array.iter().copied().collect::<Vec<T>>())?,
    }
    writer.finish()
}

/// The bytes before the elements: of the same length for any `count`, and a multiple of 64, as NumPy's are.
fn header(element: &str, count: usize, inner: &[usize]) -> Vec<u8> {
    let axes: String = inner.iter().map(|n| format!("{n}, ")).collect();
    let dictionary = format!("{{'descr': {element}, 'fortran_order': False, 'shape': ({count}, {axes}), }}");
    // Room for any count: 20 digits.
    let length = (MAGIC.len() + 4 + dictionary.len() - count.to_string().len() + 20 + 1).next_multiple_of(64);
    let room = length - MAGIC.len() - 4;
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend((room as u16).to_le_bytes());
    bytes.extend(format!("{dictionary:<width$}\n", width = room - 1).into_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    /// A file as NumPy would write it.
    fn file(dictionary: &str, elements: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((dictionary.len() as u16).to_le_bytes());
        bytes.extend(dictionary.as_bytes());
        bytes.extend(elements);
        bytes
    }

    fn read(bytes: &[u8]) -> Result<Array4<f32>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        std::fs::write(&path, bytes).unwrap();
        read_array(&path)
    }

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let frames = Array4::from_shape_fn((3, 4, 5, 2), |(t, y, x, c)| (t + 2 * y + 3 * x + c) as f32 / 30.0);
        let mut writer = Writer::create(&path, &[4, 5, 2]).unwrap();
        frames.outer_iter().for_each(|frame| writer.push(frame.as_slice().unwrap()).unwrap());
        assert!(!path.exists());
        writer.finish().unwrap();
        assert_eq!(read_array(&path).unwrap(), frames);
        let opened = Frames::open(&path).unwrap();
        assert_eq!(opened.shape(), [3, 4, 5, 2]);
        assert_eq!(opened.frame(2).unwrap(), frames.index_axis(Axis(0), 2));
        let planes = planes(&opened.frame(1).unwrap());
        assert_eq!((planes.len(), planes[1].at(4, 3)), (2, frames[[1, 3, 4, 1]]));
        // An array seen through other axes is written as it is seen.
        let picture = Array3::from_shape_fn((6, 7, 3), |(y, x, c)| (y + 7 * x + 50 * c) as u8);
        write_array(&path, picture.view().permuted_axes([1, 0, 2])).unwrap();
        let read = read_array(&path).unwrap();
        assert_eq!(read.shape(), [1, 7, 6, 3]);
        assert_eq!(read[[0, 6, 5, 2]], f32::from(picture[[5, 6, 2]]) / 255.0);
        let mut uneven = Writer::<u8>::create(&path, &[4]).unwrap();
        uneven.push(&[1, 2, 3]).unwrap();
        uneven.finish().unwrap_err();
        assert_eq!(read_array(&path).unwrap(), read, "the older file stays");
    }

    #[test]
    fn headers_are_aligned_and_as_long_for_any_count() {
        for inner in [&[][..], &[1], &[1080, 1920, 3]] {
            let empty = header(f32::TYPE, 0, inner);
            assert!(empty.len().is_multiple_of(64) && empty.ends_with(b"\n"));
            assert_eq!(header(f32::TYPE, usize::MAX, inner).len(), empty.len());
        }
    }

    #[test]
    fn types_orders_and_shapes_mean_what_numpy_means() {
        let bytes = |values: &[f64]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        // NumPy's own header of `np.asfortranarray([[0, 0.25, 0.5], [0.75, 1, 0.125]])`.
        let text = "{'descr': '<f8', 'fortran_order': True, 'shape': (2, 3), }\n";
        let map = read(&file(text, &bytes(&[0.0, 0.75, 0.25, 1.0, 0.5, 0.125]))).unwrap();
        assert_eq!(map.index_axis(Axis(0), 0).index_axis(Axis(2), 0), array![[0.0, 0.25, 0.5], [0.75, 1.0, 0.125]]);
        assert!(map.is_standard_layout());
        let text = "{'descr': '|u1', 'fortran_order': True, 'shape': (2, 1, 2, 1)}";
        let frames = read(&file(text, &[0, 51, 102, 255])).unwrap();
        assert_eq!(frames.iter().copied().collect::<Vec<_>>(), [0.0, 0.4, 0.2, 1.0]);
        let text = "{\"shape\":(1,2,1),\"descr\":\"|u1\",\"fortran_order\":False}";
        assert_eq!(read(&file(text, &[0, 255])).unwrap(), array![[[[0.0], [1.0]]]]);
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let of = |element: &str, shape: &str, elements: usize| {
            let text = format!("{{'descr': {element}, 'fortran_order': False, 'shape': {shape}, }}\n");
            read(&file(&text, &vec![0; elements])).unwrap_err()
        };
        let has = |error: Error, kind: Kind, words: &str| {
            assert_eq!(error.kind(), kind, "{error}");
            assert!(error.to_string().contains(words), "{error} has no {words:?}");
        };
        has(of("'>f4'", "(2, 2)", 16), Kind::Unsupported, "type \">f4\"");
        has(of("'<c8'", "(2, 2)", 32), Kind::Unsupported, "astype");
        has(of("[('x', '<f4')]", "(2, 2)", 16), Kind::Unsupported, "type \"structure\"");
        has(of("'|u1'", "(4,)", 4), Kind::Data, "has 1 axis");
        has(of("'|u1'", "()", 1), Kind::Data, "has 0 axes");
        has(of("'|u1'", "(1, 1, 1, 1, 1)", 1), Kind::Data, "has 5 axes");
        has(of("'|u1'", "(2, 0, 1)", 0), Kind::Limit, "shape is (2, 0, 1)");
        has(of("'|u1'", "(30, 100, 200)", 0), Kind::Limit, "a[..., None]");
        has(of("'<f4'", "(99999, 8000, 8000, 64)", 8), Kind::Data, "is truncated");
        has(of("'<f4'", "(99999999999999999999, 8)", 8), Kind::Data, "does not tell the shape");
        has(of("'<f4'", "(18446744073709551615, 8)", 8), Kind::Limit, "pixels a side");
        has(of("'|u1'", "(2, 2)", 3), Kind::Data, "is truncated");
        has(of("'|u1'", "(2, 2)", 5), Kind::Data, "is longer");
        has(of("'|u1'", &"(".repeat(60_000), 0), Kind::Data, "does not tell the shape");
        has(read(b"").unwrap_err(), Kind::Data, "not an .npy file");
        has(read(b"PK\x03\x04 an .npz").unwrap_err(), Kind::Data, "not an .npy file");
        has(read(b"\x93NUMPY\x09\x00\x00\x00").unwrap_err(), Kind::Unsupported, "version 9");
        has(read(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}").unwrap_err(), Kind::Data, "header is damaged");
        has(read(&file("{}", &[])).unwrap_err(), Kind::Data, "type of the numbers");
        has(read(&file("{'descr': '|u1'}", &[])).unwrap_err(), Kind::Data, "order of the axes");
    }

    #[test]
    fn values_that_are_no_share_of_one_are_named_with_their_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        for (value, words) in [(f32::NAN, "not a number"), (1.5, "1.5"), (-0.25, "-0.25"), (f32::INFINITY, "inf")] {
            let mut map = Array2::<f32>::zeros((3, 4));
            map[[1, 2]] = value;
            write_array(&path, map.view()).unwrap();
            let text = read_array(&path).unwrap_err().to_string();
            assert!(text.contains(words) && text.contains("row 1, column 2, channel 0"), "{text}");
        }
    }
}
