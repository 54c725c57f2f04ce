//! What keeps a reader from being fooled: measures that are won by doing badly, or that no method was needed for.

use super::{Row, SceneRows, Sort};
use crate::measure::{ALL, Measure};

/// Sharpness retention below which a video is soft.
const SOFT: f64 = 0.7;
/// Sharpness retention above which it is grainy, or shows seams.
const GRAINY: f64 = 1.3;
/// Contrast dip below which it pulses.
const PULSES: f64 = 0.85;
/// Slope of sharpness, 1/s, below which it washes out.
const FADES: f64 = -0.05;
/// Share of the frozen picture's dynamics distance from which a video hardly moves.
const STILL: f64 = 0.9;

/// Sentences about measures whose best method is known to win them by a fault (`docs/metrics.md`, "what fools it").
pub fn cautions(scene: &SceneRows) -> Vec<String> {
    let caution = |measure: &'static Measure| {
        let best = scene.best(measure)?;
        let fault = faults(scene, best).into_iter().find(|fault| fault.wins.contains(&measure.name))?;
        Some(format!("{} is best in {}, which {} wins: its {}.", best.name, measure.name, fault.name, fault.seen))
    };
    ALL.iter().filter_map(caution).chain(scene.rows.iter().filter_map(|row| beaten(scene, row))).collect()
}

/// What a method that is only a reference does better than all others: there they have brought nothing.
fn beaten(scene: &SceneRows, row: &Row) -> Option<String> {
    let badness = |row: &Row, measure: &Measure| row.value(measure).map(|v| measure.better.badness(v));
    let better = |measure: &&Measure| {
        let best = scene.methods().filter_map(|other| badness(other, measure)).reduce(f64::min);
        badness(row, measure).zip(best).is_some_and(|(own, best)| own < best)
    };
    let names: Vec<&str> = ALL.iter().filter(better).map(|measure| measure.name).collect();
    let counts = row.baseline && row.sort == Sort::Method && !names.is_empty();
    let told = "needs neither library nor exemplar, and is better than every method in";
    counts.then(|| format!("{}, the reference, {told}: {}.", row.name, names.join(", ")))
}

/// Something that a video does badly, and the measures that it makes look good.
struct Fault {
    name: &'static str,
    seen: String,
    wins: &'static [&'static str],
}

fn faults(scene: &SceneRows, row: &Row) -> Vec<Fault> {
    let value = |name: &str| row.values.get(name).copied();
    let mut faults = Vec::new();
    let mut add = |when: bool, name, seen, wins| {
        if when {
            faults.push(Fault { name, seen, wins });
        }
    };
    if let Some(sharp) = value("sharpness retention") {
        let seen = || format!("sharpness retention is {sharp:.2}");
        add(sharp < SOFT, "blur", seen(), &["warp error", "flicker", "seam ratio", "largest step ratio"][..]);
        add(sharp > GRAINY, "noise", seen(), &["contrast dip"]);
    }
    if let Some(slope) = value("sharpness slope") {
        // What merges into large flat parts that slide changes as strongly as real fluid, and is easily carried along.
        let wins = &["dynamics distance", "dynamics shape distance", "direction error", "warp error", "flicker"];
        add(slope < FADES, "washing out", format!("sharpness falls by {:.2} a second", -slope), wins);
    }
    if let Some(dip) = value("contrast dip") {
        add(dip < PULSES, "a cross-fade", format!("contrast dips to {dip:.2}"), &["loop ratio"]);
    }
    let frozen = scene.rows.iter().find(|row| row.sort == Sort::Frozen);
    let held = frozen.and_then(|row| row.values.get("dynamics distance"));
    if let Some((moves, held)) = value("dynamics distance").zip(held) {
        let wins = &["warp error", "flicker", "patch distance", "colour distance", "loop ratio", "sharpness retention"];
        let seen = format!("dynamics distance is {moves:.3}, the frozen picture's {held:.3}");
        add(moves > STILL * held, "standing still", seen, wins);
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, sort: Sort, values: &[(&str, f64)]) -> Row {
        let values = values.iter().map(|(name, v)| ((*name).to_owned(), *v)).collect();
        Row { name: name.into(), sort, values, video: Some(String::new()), ..Row::default() }
    }

    #[test]
    fn who_wins_by_a_fault_is_told() {
        let frozen = row("frozen", Sort::Frozen, &[("dynamics distance", 0.05), ("warp error", 0.0)]);
        let soft =
            [("warp error", 0.01), ("sharpness retention", 0.4), ("loop ratio", 1.1), ("dynamics distance", 0.01)];
        let still =
            [("warp error", 0.02), ("sharpness retention", 0.9), ("loop ratio", 1.0), ("dynamics distance", 0.05)];
        let rows = vec![frozen, row("soft", Sort::Method, &soft), row("still", Sort::Method, &still)];
        let told = cautions(&SceneRows { rows, ..SceneRows::default() });
        let has = |part: &str| told.iter().any(|line| line.contains(part));
        assert!(has("soft is best in warp error, which blur wins"), "{told:?}");
        assert!(has("still is best in loop ratio, which standing still wins"), "{told:?}");
        assert!(!has("best in dynamics distance") && !has("frozen is"), "{told:?}");
    }

    #[test]
    fn motion_won_by_washing_out_is_told() {
        let fades = row("fades", Sort::Method, &[("dynamics distance", 0.01), ("sharpness slope", -0.1)]);
        let lasts = row("lasts", Sort::Method, &[("dynamics distance", 0.02), ("sharpness slope", 0.0)]);
        let told = cautions(&SceneRows { rows: vec![fades, lasts], ..SceneRows::default() });
        let expected =
            "fades is best in dynamics distance, which washing out wins: its sharpness falls by 0.10 a second.";
        assert_eq!(told, [expected]);
    }

    #[test]
    fn a_reference_that_beats_all_methods_is_told() {
        let plain = Row { baseline: true, ..row("advect", Sort::Method, &[("warp error", 0.01), ("flicker", 0.2)]) };
        let method = row("a", Sort::Method, &[("warp error", 0.02), ("flicker", 0.1)]);
        let told = cautions(&SceneRows { rows: vec![plain, method], ..SceneRows::default() });
        assert_eq!(told.len(), 1, "{told:?}");
        assert!(
            told[0].starts_with("advect, the reference, needs") && told[0].ends_with("in: warp error."),
            "{told:?}"
        );
    }
}
