//! A run as NumPy arrays, for Python: its frames, the motion, and which piece went where.
//!
//! | file | shape | what |
//! |---|---|---|
//! | `frames.npy` | (frames, height, width, 3 or 4) `uint8` | red, green, blue, and opacity where it was asked for |
//! | `motion.npy` | (y, x, 2) `float32` | the motion that was used (u right, v down), pixels of the working image per frame |
//! | `asked-direction.npy` | (y, x, 2) `float32` | what was asked: unit vectors, shorter where strokes disagree, 0 where nothing |
//! | `asked-speed.npy` | (y, x) `float32` | in the unit of `motion.npy`, below 0 where none was asked |
//! | `labels.npy` | (rows, columns) `int32` | of every node of the grid the number of its piece, equal for equal pieces; −1 where no node is |
//! | `nodes.npy` | (rows, columns), a structure | of every node which library, clip, variant and place its piece is from, and how that moves |
//!
//! What a method does not have is not written.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use bytemuck::{NoUninit, Zeroable};
use ndarray::{Array2, Axis};

use crate::assign::nodes::{STRIDE, positions};
use crate::base::atomic_file::AtomicFolder;
use crate::base::error::Result;
use crate::library::piece::PieceRef;
use crate::raster::npy::{Element, write_array};
use crate::synth::method::Outcome;
use crate::synth::record::{NodeRecord, RunRecord};

/// All files that may be in the folder.
const NAMES: [&str; 6] =
    ["frames.npy", "motion.npy", "asked-direction.npy", "asked-speed.npy", "labels.npy", "nodes.npy"];

/// A folder of arrays being filled, which appears whole, in place of the arrays of an earlier run.
pub struct Arrays(AtomicFolder);

impl Arrays {
    /// Begins the folder `path`.
    ///
    /// # Errors
    /// A folder that holds anything but arrays of these names, or a place that cannot be written to.
    pub fn create(path: &Path) -> Result<Self> {
        AtomicFolder::create(path, |name| NAMES.contains(&name)).map(Self)
    }

    /// Where the frames go until the folder is finished.
    pub fn frames(&self) -> PathBuf {
        self.0.inside("frames.npy")
    }

    /// Adds all but the frames and gives the folder its name.
    ///
    /// # Errors
    /// A full disk.
    pub fn finish(self, outcome: &Outcome) -> Result<()> {
        for (name, array) in &outcome.arrays {
            let path = self.0.inside(&format!("{name}.npy"));
            match array.dim().2 {
                1 => write_array(&path, array.index_axis(Axis(2), 0))?,
                _ => write_array(&path, array.view())?,
            }
        }
        if let Some((labels, nodes)) = nodes(&outcome.record) {
            write_array(&self.0.inside("labels.npy"), labels.view())?;
            write_array(&self.0.inside("nodes.npy"), nodes.view())?;
        }
        self.0.commit()
    }
}

/// A node with its piece, as NumPy sees it.
#[derive(Debug, Clone, Copy, PartialEq, NoUninit, Zeroable)]
#[repr(C)]
struct Entry {
    /// Which library, by its place in the scene's list; −1 where no node is.
    library: i32,
    /// The clip, as reports name it.
    clip: [u8; 16],
    /// Number of the variant, see [`crate::library::variant`].
    variant: i32,
    /// Left and top edge of the piece on the variant's canvas, pixels.
    place: [i32; 2],
    /// Mean motion as it is played, pixels of the working image per frame.
    motion: [f32; 2],
    /// Mean length of its motion.
    activity: f32,
    /// Rate of playback.
    rate: f32,
}

impl Element for Entry {
    const TYPE: &'static str = "[('library', '<i4'), ('clip', 'S16'), ('variant', '<i4'), ('place', '<i4', (2,)), \
                                ('motion', '<f4', (2,)), ('activity', '<f4'), ('rate', '<f4')]";
}

impl Entry {
    fn of(node: &NodeRecord) -> Self {
        let mut clip = [0; 16];
        clip.iter_mut().zip(node.piece.clip.to_string().bytes()).for_each(|(to, from)| *to = from);
        Self {
            library: node.library as i32,
            clip,
            variant: i32::from(node.piece.variant.index()),
            place: [node.piece.x, node.piece.y].map(i32::from),
            motion: [node.motion.0, node.motion.1],
            activity: node.activity,
            rate: node.rate,
        }
    }
}

/// The numbers of the pieces, in their order, and the nodes, both in rows and columns of the grid; none of a method that
/// assigns no pieces.
fn nodes(record: &RunRecord) -> Option<(Array2<i32>, Array2<Entry>)> {
    let nodes = &record.assignment.as_ref()?.nodes;
    let mut numbers: BTreeMap<(usize, PieceRef), i32> = nodes.iter().map(|n| ((n.library, n.piece), 0)).collect();
    (0..).zip(numbers.values_mut()).for_each(|(i, number)| *number = i);
    let size = (positions(record.working_size.1), positions(record.working_size.0));
    let mut labels = Array2::from_elem(size, -1);
    let mut entries = Array2::from_elem(size, Entry { library: -1, ..Entry::zeroed() });
    for node in nodes {
        let at = [node.y / STRIDE, node.x / STRIDE];
        labels[at] = numbers[&(node.library, node.piece)];
        entries[at] = Entry::of(node);
    }
    Some((labels, entries))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::library::piece::ClipId;
    use crate::library::variant::Variant;
    use crate::raster::npy::read_array;
    use crate::synth::record::AssignmentRecord;
    use ndarray::{Array3, array};

    fn node(x: usize, y: usize, piece: u16) -> NodeRecord {
        let piece = PieceRef { clip: ClipId([0xab; 32]), variant: Variant::from_index(3).unwrap(), x: piece, y: 8 };
        NodeRecord {
            x,
            y,
            library: 1,
            piece,
            motion: (1.5, -0.5),
            activity: 2.0,
            rate: 1.0,
            asked: None,
            asked_speed: None,
        }
    }

    #[test]
    fn nodes_lie_in_rows_and_columns_and_equal_pieces_have_equal_numbers() {
        let assignment =
            AssignmentRecord { nodes: vec![node(24, 0, 40), node(0, 24, 4), node(48, 24, 40)], ..Default::default() };
        let record = RunRecord { assignment: Some(assignment), working_size: (96, 70), ..RunRecord::default() };
        let (labels, entries) = nodes(&record).unwrap();
        assert_eq!(labels, array![[-1, 1, -1], [0, -1, 1]]);
        assert_eq!((entries[[0, 0]].library, entries[[1, 0]].library, entries[[1, 0]].place), (-1, 1, [4, 8]));
        assert_eq!((&entries[[0, 1]].clip, entries[[0, 1]].motion), (b"abababababababab", [1.5, -0.5]));
        assert!(nodes(&RunRecord::default()).is_none());
    }

    #[test]
    fn a_folder_of_arrays_appears_whole_and_replaces_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("arrays");
        let outcome = Outcome {
            record: RunRecord::default(),
            pictures: Vec::new(),
            arrays: vec![("motion", Array3::from_elem((4, 5, 2), 0.25)), ("asked-speed", Array3::zeros((4, 5, 1)))],
        };
        let names = || {
            let mut names: Vec<_> = std::fs::read_dir(&path).unwrap().map(|e| e.unwrap().file_name()).collect();
            names.sort();
            names
        };
        Arrays::create(&path).unwrap().finish(&outcome).unwrap();
        assert_eq!(names(), ["asked-speed.npy", "motion.npy"]);
        assert_eq!(read_array(&path.join("motion.npy")).unwrap().shape(), [1, 4, 5, 2]);
        assert_eq!(read_array(&path.join("asked-speed.npy")).unwrap().shape(), [1, 4, 5, 1]);
        Arrays::create(&path).unwrap().finish(&Outcome { arrays: Vec::new(), ..outcome }).unwrap();
        assert!(names().is_empty(), "an earlier run's arrays go");
        std::fs::write(path.join("mine.npy"), "").unwrap();
        assert!(Arrays::create(&path).is_err());
    }
}
