//! Options declared once: name, description, unit, range, default and where the paper speaks of them.
//!
//! [`declare_options!`] makes a plain struct from the declarations; the same declarations
//! check scene files and command lines and write the documentation.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::error::{Error, Kind, Result};

/// Keys up to this many are all listed where one is not known; of more, the nearest.
const SHORT_LIST: usize = 12;
const LISTED: usize = 5;

/// A value as a scene file or a command line gives it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// `true` or `false`.
    Switch(bool),
    /// A whole number.
    Integer(i64),
    /// Any other number.
    Number(f64),
    /// Anything else.
    Text(String),
}

impl Value {
    /// Reads what a person typed: a switch, a number, or else text.
    pub fn parse(text: &str) -> Self {
        match text.trim() {
            "true" | "on" | "yes" => Self::Switch(true),
            "false" | "off" | "no" => Self::Switch(false),
            other => other
                .parse::<i64>()
                .map(Self::Integer)
                .or_else(|_| other.parse::<f64>().map(Self::Number))
                .unwrap_or_else(|_| Self::Text(other.to_owned())),
        }
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Switch(v) => write!(f, "{v}"),
            Self::Integer(v) => write!(f, "{v}"),
            Self::Number(v) => write!(f, "{v}"),
            Self::Text(v) => write!(f, "{v:?}"),
        }
    }
}

/// Options as read, unchecked, in order of name.
pub type Table = BTreeMap<String, Value>;

/// One option's declaration.
#[derive(Debug, Clone, PartialEq)]
pub struct Declared {
    /// Name, as a scene file writes it.
    pub name: &'static str,
    /// What it does, and which way is more.
    pub doc: &'static str,
    /// Unit of the value.
    pub unit: &'static str,
    /// Smallest and largest value; (0, 1) for switches, places within [`Declared::words`] for words.
    pub range: (f64, f64),
    /// The words to choose from, where the value is one.
    pub words: Vec<&'static str>,
    /// Value when nobody says otherwise.
    pub default: Value,
    /// Where the method's paper (or our notes) speaks of it.
    pub section: &'static str,
    /// Whether only those need it who know the method.
    pub expert: bool,
}

/// Marks an option in [`declare_options!`] that only those need who know the method.
pub const EXPERT: bool = true;

/// A type an option can have.
pub trait OptionType: Sized {
    /// From a value of the right sort.
    fn from_value(value: &Value) -> Option<Self>;
    /// As a value.
    fn to_value(&self) -> Value;
    /// Position within the declared range.
    fn number(&self) -> f64;
    /// The words to choose from, where the value is one.
    fn words() -> Vec<&'static str> {
        Vec::new()
    }
    /// The sort of value, for people.
    const SORT: &'static str;
}

/// A choice between words.
pub trait Words: Copy + PartialEq + 'static {
    /// Every word with its meaning.
    const ALL: &'static [(&'static str, Self)];
}

impl<T: Words> OptionType for T {
    const SORT: &'static str = "one of these words";
    fn from_value(value: &Value) -> Option<Self> {
        let Value::Text(text) = value else { return None };
        T::ALL.iter().find(|(word, _)| word == text).map(|found| found.1)
    }
    fn to_value(&self) -> Value {
        Value::Text(T::ALL[self.number() as usize].0.to_owned())
    }
    fn number(&self) -> f64 {
        T::ALL.iter().position(|(_, meaning)| meaning == self).unwrap_or(0) as f64
    }
    fn words() -> Vec<&'static str> {
        T::ALL.iter().map(|(word, _)| *word).collect()
    }
}

impl OptionType for f32 {
    const SORT: &'static str = "a number";
    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Integer(v) => Some(*v as f32),
            Value::Number(v) => Some(*v as f32),
            _ => None,
        }
    }
    fn to_value(&self) -> Value {
        // Through the shortest decimal, so that 0.3 is written as 0.3.
        Value::Number(self.to_string().parse().unwrap_or(f64::from(*self)))
    }
    fn number(&self) -> f64 {
        f64::from(*self)
    }
}

impl OptionType for usize {
    const SORT: &'static str = "a whole number";
    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Integer(v) => usize::try_from(*v).ok(),
            _ => None,
        }
    }
    fn to_value(&self) -> Value {
        Value::Integer(*self as i64)
    }
    fn number(&self) -> f64 {
        *self as f64
    }
}

impl OptionType for bool {
    const SORT: &'static str = "true or false";
    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Switch(v) => Some(*v),
            _ => None,
        }
    }
    fn to_value(&self) -> Value {
        Value::Switch(*self)
    }
    fn number(&self) -> f64 {
        f64::from(u8::from(*self))
    }
}

/// Reads one option, or its default when `table` does not have it.
///
/// # Errors
/// A value of the wrong sort or out of range, by name.
pub fn read<T: OptionType>(owner: &str, declared: &Declared, default: T, table: &Table) -> Result<T> {
    let Some(value) = table.get(declared.name) else { return Ok(default) };
    let (low, high) = declared.range;
    let name = format!("{owner}.{}", declared.name);
    let allowed = || match &T::words()[..] {
        [] if T::SORT == bool::SORT => T::SORT.to_owned(),
        [] => format!("{} from {low} to {high}", T::SORT),
        words => words.join(", "),
    };
    let read = T::from_value(value)
        .ok_or_else(|| Error::new(Kind::Usage, &name, format!("{value} is not {}", T::SORT)).allowed(allowed()))?;
    if !(low..=high).contains(&read.number()) {
        return Err(Error::new(Kind::Usage, name, format!("{value} is out of range")).allowed(allowed()));
    }
    Ok(read)
}

/// Refuses keys that are not among `known`, naming the nearest one.
///
/// # Errors
/// The first unknown key.
pub fn refuse_unknown<'a>(owner: &str, keys: impl IntoIterator<Item = &'a str>, known: &[&'static str]) -> Result<()> {
    match keys.into_iter().find(|key| !known.contains(key)) {
        None => Ok(()),
        Some(key) => Err(unknown(owner, key, known)),
    }
}

/// The error for an unknown `key` of `owner`.
pub fn unknown(owner: &str, key: &str, known: &[&str]) -> Error {
    let subject = if owner.is_empty() { key.to_owned() } else { format!("{owner}.{key}") };
    let mut nearby = known.to_vec();
    let mut allowed = known.join(", ");
    if known.len() > SHORT_LIST {
        nearby.sort_by_key(|k| distance(key, k));
        allowed = format!("{} and {} more", nearby[..LISTED].join(", "), known.len() - LISTED);
    }
    let error = Error::new(Kind::Usage, subject, "no such key").allowed(allowed);
    match nearest(key, known) {
        Some(name) => error.remedy(format!("did you mean {name:?}?")),
        None => error,
    }
}

/// What is wrong with a TOML file of the text `text` and in which line, in words for people.
pub fn explain(error: &toml::de::Error, text: &str) -> String {
    let line = error.span().map(|s| text.get(..s.start).unwrap_or_default().matches('\n').count() + 1);
    let said = if line.is_some() { error.message().to_owned() } else { error.to_string() };
    if said.contains("untagged enum Value") {
        return "an option is a number, true or false, or a word".to_owned();
    }
    if let Some(number) = said.split("integer `-").nth(1).and_then(|rest| rest.split('`').next()) {
        let place =
            error.span().and_then(|span| key_of(text, span.start)).map_or(String::new(), |key| format!("{key} = "));
        return at_line(line, &format!("{place}-{number} is below 0; write a whole number from 0 on"));
    }
    let words = said.split_whitespace().map(|word| match word.trim_end_matches(',') {
        "usize" | "u64" => "a whole number",
        "f32" => "a number",
        _ => word,
    });
    let said = words.collect::<Vec<_>>().join(" ");
    let key = error.span().and_then(|span| key_of(text, span.start)).filter(|key| !said.contains(&format!("`{key}`")));
    at_line(line, &key.map_or(said.clone(), |key| format!("{key}: {said}")))
}

fn at_line(line: Option<usize>, said: &str) -> String {
    line.map_or(said.to_owned(), |line| format!("line {line}: {said}"))
}

/// The key whose value is at a place of a TOML text; none where the line has none before it.
fn key_of(text: &str, place: usize) -> Option<&str> {
    let (key, _) = text.get(..place)?.lines().last()?.split_once('=')?;
    Some(key.trim())
}

/// The known name nearest to `name` by edit distance, when it is near enough to be meant.
pub fn nearest<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    let best = known.iter().map(|&k| (distance(name, k), k)).min()?;
    (best.0 <= name.chars().count().max(best.1.len()) / 2).then_some(best.1)
}

/// Edit distance between two names, ignoring case; two neighbouring letters the wrong way round are one mistake.
fn distance(a: &str, b: &str) -> usize {
    strsim::osa_distance(&a.to_lowercase(), &b.to_lowercase())
}

/// Declares a struct of options: each field once, with documentation, type, default, range, unit and section; behind that
/// [`EXPERT`] where it is for those who know the method.
///
/// The struct gets `Default`, `declared() -> Vec<Declared>`, `from_table(&Table) -> Result<Self>` (unknown keys, wrong
/// sorts and ranges are errors) and `to_table() -> Table`.
#[macro_export]
macro_rules! declare_options {
    (
        $(#[$outer:meta])*
        pub struct $name:ident named $owner:literal {
            $( $(#[doc = $doc:literal])+
               $field:ident: $type:ty = $default:expr, in $low:expr, $high:expr, $unit:literal, $section:literal
               $(, $expert:ident)?; )*
        }
    ) => {
        $(#[$outer])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name {
            $( $(#[doc = $doc])+ pub $field: $type, )*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $( $field: $default, )* }
            }
        }

        impl $name {
            /// The declarations, in order.
            pub fn declared() -> Vec<$crate::base::options::Declared> {
                use $crate::base::options::OptionType;
                let default = Self::default();
                vec![$( $crate::base::options::Declared {
                    name: stringify!($field),
                    doc: concat!($($doc),+).trim_ascii(),
                    unit: $unit,
                    range: ($low as f64, $high as f64),
                    words: <$type as OptionType>::words(),
                    default: default.$field.to_value(),
                    section: $section,
                    expert: false $( || $crate::base::options::$expert )?,
                }, )*]
            }

            /// Reads and checks a table; options it does not name keep their defaults.
            ///
            /// # Errors
            /// Unknown keys, values of the wrong sort or out of range, by name.
            pub fn from_table(table: &$crate::base::options::Table) -> $crate::base::error::Result<Self> {
                Self::from_table_of($owner, table)
            }

            /// The same for a table that another owner, who has these options too, is blamed for.
            ///
            /// # Errors
            /// As [`Self::from_table`].
            pub fn from_table_of(
                owner: &str,
                table: &$crate::base::options::Table,
            ) -> $crate::base::error::Result<Self> {
                let known = [$( stringify!($field), )*];
                $crate::base::options::refuse_unknown(owner, table.keys().map(String::as_str), &known)?;
                let default = Self::default();
                let declared = Self::declared();
                let mut declared = declared.iter();
                Ok(Self { $( $field: $crate::base::options::read(
                    owner, declared.next().expect("one declaration a field"), default.$field, table)?, )* })
            }

            /// Every option with its value.
            pub fn to_table(&self) -> $crate::base::options::Table {
                use $crate::base::options::OptionType;
                [$( (stringify!($field).to_owned(), self.$field.to_value()), )*].into_iter().collect()
            }
        }
    };
}

pub use declare_options;

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, Clone, Copy, PartialEq)]
    pub enum Order {
        Rising,
        Falling,
    }

    impl Words for Order {
        const ALL: &'static [(&'static str, Self)] = &[("rising", Self::Rising), ("falling", Self::Falling)];
    }

    declare_options! {
        /// Options of a test.
        pub struct Sample named "sample" {
            /// How strong.
            strength: f32 = 0.3, in 0.0, 2.0, "ratio", "§1";
            /// How many.
            count: usize = 100, in 1, 1000, "pieces", "§2";
            /// Whether.
            quick: bool = false, in 0, 1, "", "§3", EXPERT;
            /// Which way.
            order: Order = Order::Rising, in 0, 1, "", "§4";
        }
    }

    fn table(text: &[(&str, &str)]) -> Table {
        text.iter().map(|(k, v)| ((*k).to_owned(), Value::parse(v))).collect()
    }

    #[test]
    fn declared_once_serves_reading_writing_and_documentation() {
        let sample = Sample::from_table(&table(&[("strength", "1"), ("quick", "true"), ("order", "falling")])).unwrap();
        assert_eq!(sample, Sample { strength: 1.0, count: 100, quick: true, order: Order::Falling });
        assert_eq!(Sample::from_table(&sample.to_table()).unwrap(), sample);
        assert_eq!(Sample::default().to_table()["strength"], Value::Number(0.3));
        assert_eq!(Sample::declared()[1].doc, "How many.");
        assert_eq!(Sample::declared().iter().map(|d| d.expert).collect::<Vec<_>>(), [false, false, true, false]);
        assert_eq!(
            (&Sample::declared()[3].words[..], Sample::declared()[3].range),
            (&["rising", "falling"][..], (0.0, 1.0))
        );
        assert_eq!(Sample::default().to_table()["order"], Value::Text("rising".into()));
    }

    #[test]
    fn mistakes_are_named_with_a_remedy() {
        let message = |t: &[(&str, &str)]| Sample::from_table(&table(t)).unwrap_err().to_string();
        assert!(message(&[("strenght", "1")]).contains("did you mean \"strength\"?"));
        assert!(message(&[("strength", "3")]).contains("sample.strength"));
        assert!(message(&[("strength", "nan")]).contains("out of range"));
        assert!(message(&[("count", "2.5")]).contains("a whole number from 1 to 1000"));
        assert!(message(&[("quick", "1")]).contains("true or false"));
        assert!(message(&[("order", "sideways")]).contains("rising, falling"));
        assert!(!message(&[("xyzzyqwerty", "1")]).contains("did you mean"));
        assert!(message(&[("qiuck", "1")]).contains("did you mean \"quick\"?"));
    }

    #[test]
    fn letters_the_wrong_way_round_are_one_mistake_and_long_lists_are_cut() {
        assert_eq!(
            [distance("tua", "tau"), distance("Tau", "tau"), distance("abc", ""), distance("ca", "abc")],
            [1, 0, 3, 3]
        );
        let names: Vec<String> = (10..30).map(|i| format!("name{i}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).chain(["tau"]).collect();
        let said = unknown("method", "tua", &names).to_string();
        assert!(
            said.contains("method.tua") && said.contains("(allowed: tau, ") && said.contains(" and 16 more)"),
            "{said}"
        );
        assert!(said.ends_with("did you mean \"tau\"?"), "{said}");
    }
}
