//! `enliven`: animates a picture.

fn main() {}
