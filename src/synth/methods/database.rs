//! The database method: motion borrowed piece by piece from a library (Okabe, Anjyo & Onai 2011).

use crate::synth::method::MethodEntry;
use crate::synth::pieces::options::Options;
use crate::synth::pieces::piece_method::PieceMethod;

/// Registry entry.
pub const ENTRY: MethodEntry = MethodEntry {
    name: "database",
    summary: "borrows motion piece by piece from a library of clips",
    citation: "Okabe, Anjyo & Onai, \"Creating Fluid Animation from a Single Image using Video Database\", CGF 30(7), 2011",
    library: true,
    exemplars: 0,
    designed: false,
    options: Options::declared,
    complete: |table| Ok(Options::from_table(table)?.checked("database")?.to_table()),
    preview: Options::shrink,
    build: |table| Ok(Box::new(PieceMethod::new("database", Options::from_table(table)?.checked("database")?, None))),
};
