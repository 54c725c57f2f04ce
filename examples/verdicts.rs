//! Judges every clip of `clips.tsv` in the folder that `ENLIVEN_DATA` names, and compares with its `fixed_camera` column.
//!
//! `ENLIVEN_DATA=… cargo run --release --example verdicts [NAME…]` (only the clips whose path contains a name)

use std::path::Path;

use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::Silent;
use enliven::library::acceptance::{Camera, Reason, Report};
use enliven::library::options::Options;
use enliven::library::scan::{Judged, judge};

/// Whether the judgement of the camera agrees with the column; "small drift" agrees with either, given a number.
fn agrees(column: &str, report: &Report) -> bool {
    let moves = report.reasons.iter().any(|reason| matches!(reason, Reason::CameraMoves { .. }));
    match column {
        "no" => moves,
        "small drift" | "not measurable" => true,
        _ => !moves,
    }
}

fn line(report: &Report) -> String {
    let camera = match report.camera {
        Camera::Measured { pixels, coverage } => format!("{pixels:.2} px ({:.0} %)", coverage * 100.0),
        Camera::NotMeasurable => "not measurable".into(),
    };
    let verdict = match &report.usable {
        Some(_) if report.accepted() => "accepted".into(),
        Some(frames) => format!("in part: frames {} to {}", frames.start, frames.end),
        None => "refused".into(),
    };
    let reasons = report.reasons.iter().map(Reason::to_string).collect::<Vec<_>>().join("; ");
    format!("{:4} | {camera:20} | {:3.0} % | {verdict} | {reasons}", report.frames, report.moving * 100.0)
}

fn main() -> Result<()> {
    let Some(root) = std::env::var_os("ENLIVEN_DATA") else {
        println!("set ENLIVEN_DATA to the folder that holds clips.tsv");
        return Ok(());
    };
    let root = Path::new(&root);
    let only: Vec<String> = std::env::args().skip(1).collect();
    let table = root.join("clips.tsv");
    let text = std::fs::read_to_string(&table).map_err(|e| Error::io(&table, "read", e))?;
    let (mut clips, mut agreements) = (0, 0);
    println!("clip | fixed camera | frames | camera, followed | moving | verdict | reasons | agrees");
    for row in text.lines().skip(1) {
        let mut columns = row.split('\t');
        let (Some(file), Some(column)) = (columns.next(), columns.next()) else {
            return Err(Error::file(Kind::Data, &table, "a row with fewer than two columns"));
        };
        if !only.is_empty() && !only.iter().any(|name| file.contains(name.as_str())) {
            continue;
        }
        clips += 1;
        match judge(&root.join(file), &Options::default(), &Silent) {
            Ok(Judged { report, .. }) => {
                let agrees = agrees(column, &report);
                agreements += usize::from(agrees);
                println!("{file} | {column} | {} | {}", line(&report), if agrees { "yes" } else { "NO" });
            }
            Err(error) => println!("{file} | {column} | unreadable: {error}"),
        }
    }
    println!("{agreements} of {clips} agree");
    Ok(())
}
