//! Every instruction set that the machine has gives the same results, and can be asked for.

use std::fs;
use std::path::Path;
use std::process::Output;

use enliven::base::instructions::{InstructionSet, VARIABLE};
use enliven::raster::image::Rgb8;
use enliven::raster::picture_io::{read_picture, write_png};

use crate::common;

fn run(folder: &Path, program: &str, set: &str, line: &str) -> Output {
    let mut command = assert_cmd::Command::cargo_bin(program).unwrap();
    command.current_dir(folder).env(VARIABLE, set).args(line.split_whitespace()).output().unwrap()
}

fn succeed(folder: &Path, program: &str, set: &str, line: &str) -> String {
    let output = run(folder, program, set, line);
    assert!(output.status.success(), "{set}: {line}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn sets_agree() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    common::write_clip(&at("a.y4m"), 10);
    let pixel = |i: usize| ((i / 3 % 112) * 2 + (i * 7919) % 31) as u8;
    write_png(&at("p.png"), &Rgb8 { width: 112, height: 80, data: (0..112 * 80 * 3).map(pixel).collect() }).unwrap();
    let sets: Vec<&str> = InstructionSet::available().map(InstructionSet::name).collect();
    for set in &sets {
        let version = succeed(folder.path(), "enliven", set, "--version");
        assert!(version.contains(&format!("(instructions: {set}")), "{version}");
        for line in [format!("--instructions {set} --version"), format!("--instructions={set} --version")] {
            assert_eq!(succeed(folder.path(), "enliven", sets[0], &line), version);
        }
        succeed(folder.path(), "enliven-db", set, &format!("build a.y4m -o {set}.pack --stride 16"));
        let common = "animate p.png --direction 90 --frames 4 --size 112x80";
        succeed(folder.path(), "enliven", set, &format!("{common} --method database --library {set}.pack -o {set}-d"));
        succeed(folder.path(), "enliven", set, &format!("{common} --method lazyfluids -o {set}-l"));
        let summary = fs::read_to_string(at(&format!("{set}-d.summary.json"))).unwrap();
        assert!(summary.contains(&format!("\"instructions\": \"{set}\"")), "{summary}");
    }
    // Fused multiply-add rounds once on every set that has it; without it a product of matrices rounds twice.
    let fused = sets.iter().filter(|set| **set != "portable").map(|set| fs::read(at(&format!("{set}.pack"))).unwrap());
    assert!(fused.collect::<Vec<_>>().windows(2).all(|pair| pair[0] == pair[1]));
    for (set, method) in sets[1..].iter().flat_map(|set| ["d", "l"].map(|method| (set, method))) {
        for frame in 0..4 {
            let read = |set: &str| read_picture(&at(&format!("{set}-{method}/{frame:05}.png"))).unwrap().rgb.data;
            let (best, other) = (read(sets[0]), read(set));
            let off: u64 = best.iter().zip(&other).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
            assert!(off as f64 / best.len() as f64 <= 1.0, "{set}, {method}, frame {frame}: {off}");
        }
    }
}

#[test]
fn a_set_that_is_unknown_or_missing_is_refused_by_both_programs() {
    let folder = tempfile::tempdir().unwrap();
    for program in ["enliven", "enliven-db"] {
        for line in ["--version", "--help"] {
            let output = run(folder.path(), program, "avx521", line);
            let said = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(2), "{said}");
            assert!(said.contains("ENLIVEN_INSTRUCTIONS: there is no instruction set \"avx521\""), "{said}");
            assert!(said.contains("(allowed: avx512, avx2, portable)") && said.contains("\"avx512\"?"), "{said}");
        }
    }
    let output = run(folder.path(), "enliven", "portable", "methods --instructions sse");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8(output.stderr).unwrap().contains("there is no instruction set \"sse\""));
    for set in InstructionSet::ALL.into_iter().filter(|set| InstructionSet::available().all(|there| there != *set)) {
        let output = run(folder.path(), "enliven", set.name(), "methods");
        assert_eq!(output.status.code(), Some(2));
        assert!(String::from_utf8(output.stderr).unwrap().contains("this machine does not have"));
    }
}
