//! The result in sentences and numbers for people.

use super::findings::{BlindTest, Judged, Planted};
use crate::base::text::counted;
use crate::measure::preference::Estimate;

impl BlindTest {
    /// How many voted, and on what.
    pub fn summary(&self) -> String {
        if self.voters == 0 {
            return "nobody has voted yet".into();
        }
        format!("{}, {}", counted(self.voters as u64, "voter"), counted(self.votes as u64, "vote"))
    }

    /// Whether the votes mean anything, by what was planted.
    pub fn verdict(&self) -> String {
        let shown: Vec<&Planted> = self.planted.iter().filter(|planted| planted.won.is_some()).collect();
        if shown.is_empty() {
            return "No planted bad video was voted on, so nothing tells whether these votes mean anything.".into();
        }
        let told = |all: &[&Planted]| all.iter().map(|planted| planted.told()).collect::<Vec<_>>().join(", ");
        let missed: Vec<&Planted> = shown.iter().copied().filter(|planted| !planted.found_out()).collect();
        if missed.is_empty() {
            return format!("The votes mean something: what was planted to be bad lost ({}).", told(&shown));
        }
        format!(
            "These votes mean little: what was planted to be bad did not clearly lose ({}). Either there are too few votes, \
             or the voters cannot tell, or the methods are no better.",
            told(&missed)
        )
    }

    /// What else a reader should know before believing the numbers.
    pub fn remarks(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        if let Some(agreement) = self.agreement {
            remarks.push(format!(
                "Of {} that a voter saw again with sides swapped, {} were judged the same.",
                counted(self.repeats as u64, "pair"),
                percent(agreement)
            ));
        }
        if let Some(left) = self.left {
            let bias = match (left.low > 0.5, left.high < 0.5) {
                (true, _) => "the left side was favoured",
                (_, true) => "the right side was favoured",
                _ => "no side was clearly favoured",
            };
            remarks.push(format!("Left was chosen in {} of the decided votes: {bias}.", percent(left)));
        }
        if self.outdated > 0 {
            let anew: Vec<String> = self.replaced.iter().map(|(scene, row)| format!("{scene}, {row}")).collect();
            remarks.push(format!(
                "{} no longer {}: their videos were made anew or left out since ({}).",
                counted(self.outdated as u64, "vote"),
                if self.outdated == 1 { "counts" } else { "count" },
                anew.join("; ")
            ));
        }
        if self.stale {
            remarks.push(
                "The page that people vote on shows videos from before the last run; run it with --blind to renew it."
                    .into(),
            );
        }
        remarks
    }

    /// The pooled standing as lines of a table.
    pub fn table(&self) -> Vec<String> {
        let width = self.pooled.rows.iter().map(|row| row.name.chars().count()).max().unwrap_or(0).max(3);
        let head = format!("  {:width$}  {:>5}  {:18}strength", "row", "votes", "won");
        let line = |row: &Judged| {
            format!("  {:width$}  {:>5}  {:18}{}", row.name, row.votes, percent(row.won), strength(row.strength))
        };
        if self.pooled.rows.is_empty() {
            Vec::new()
        } else {
            [head].into_iter().chain(self.pooled.rows.iter().map(line)).collect()
        }
    }
}

impl Planted {
    fn told(&self) -> String {
        let won = self.won.map_or(String::new(), percent);
        format!("{} won {won} of {}", self.name, counted(self.votes as u64, "vote"))
    }
}

/// "33 % (20–49)".
pub fn percent(share: Estimate) -> String {
    let [value, low, high] = [share.value, share.low, share.high].map(|v| (100.0 * v).round());
    format!("{value} % ({low}–{high})")
}

/// "+0.34 (−0.26 to +0.94)".
pub fn strength(strength: Estimate) -> String {
    let signed = |v: f64| {
        let sign = if v < -0.005 { "−" } else { "+" };
        format!("{sign}{:.2}", v.abs())
    };
    format!("{} ({} to {})", signed(strength.value), signed(strength.low), signed(strength.high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::preference::share;

    fn planted(name: &str, won: f64, votes: usize) -> Planted {
        Planted { name: name.into(), votes, won: share(won, votes as f64) }
    }

    #[test]
    fn the_verdict_follows_from_what_was_planted() {
        let verdict = |planted: Vec<Planted>| BlindTest { planted, ..BlindTest::default() }.verdict();
        assert!(verdict(vec![]).contains("nothing tells whether"));
        assert!(verdict(vec![planted("frozen", 0.0, 0)]).contains("nothing tells whether"));
        let lost = verdict(vec![planted("frozen", 2.0, 20), planted("shuffled", 0.0, 4)]);
        assert!(
            lost.starts_with("The votes mean something") && lost.contains("frozen won 10 % (3–30) of 20 votes"),
            "{lost}"
        );
        // Three lost votes may be chance.
        let few = verdict(vec![planted("frozen", 2.0, 20), planted("shuffled", 0.0, 3)]);
        assert!(
            few.starts_with("These votes mean little") && few.contains("(shuffled won 0 % (0–56) of 3 votes)"),
            "{few}"
        );
    }

    #[test]
    fn numbers_have_signs_where_they_need_them() {
        let of = |value, low, high| strength(Estimate { value, low, high });
        assert_eq!(of(0.344, -0.26, 0.94), "+0.34 (−0.26 to +0.94)");
        assert_eq!(of(-0.004, -1.0, 0.0), "+0.00 (−1.00 to +0.00)");
    }
}
