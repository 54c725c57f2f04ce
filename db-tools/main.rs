//! `enliven-db`: builds and inspects libraries.

fn main() {}
