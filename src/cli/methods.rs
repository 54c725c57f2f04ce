//! `enliven methods`: the registry with every option.

use serde_json::json;

use crate::base::error::Result;
use crate::base::options::Declared;
use crate::cli::common::say;
use crate::synth::method::MethodEntry;
use crate::synth::methods::REGISTRY;
use crate::synth::run::check_names;

/// List the methods and all their options.
#[derive(Debug, Clone, clap::Args)]
pub struct Methods {
    /// Only these methods
    #[arg(value_name = "METHOD")]
    only: Vec<String>,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

impl Methods {
    /// Runs the command.
    ///
    /// # Errors
    /// A method that there is not.
    pub fn run(&self) -> Result<()> {
        check_names("method", &self.only)?;
        let wanted = |method: &&MethodEntry| self.only.is_empty() || self.only.iter().any(|name| name == method.name);
        if self.json {
            say!("{}", REGISTRY.iter().filter(wanted).map(as_json).collect::<serde_json::Value>());
        } else {
            REGISTRY.iter().filter(wanted).for_each(print);
        }
        Ok(())
    }
}

fn print(method: &MethodEntry) {
    say!("{}: {}\n  {}", method.name, method.summary, method.citation);
    let (experts, usual): (Vec<Declared>, Vec<Declared>) = (method.options)().into_iter().partition(|o| o.expert);
    usual.iter().for_each(|option| print_option(method, option));
    if !experts.is_empty() {
        say!("  for those who know the method:");
        experts.iter().for_each(|option| print_option(method, option));
    }
}

fn print_option(method: &MethodEntry, option: &Declared) {
    let (low, high) = option.range;
    let section = if option.section.is_empty() { String::new() } else { format!("({})", option.section) };
    let allowed = match &option.words[..] {
        [] => format!("{low} to {high} {}", option.unit),
        words => words.join(", "),
    };
    say!("  --set {}.{}={}   {allowed}\n      {} {section}", method.name, option.name, option.default, option.doc);
}

fn as_json(method: &MethodEntry) -> serde_json::Value {
    let options: Vec<_> = (method.options)()
        .iter()
        .map(|o| {
            json!({ "name": o.name, "doc": o.doc, "unit": o.unit, "range": [o.range.0, o.range.1],
                "words": o.words, "default": o.default, "section": o.section, "expert": o.expert })
        })
        .collect();
    json!({ "name": method.name, "summary": method.summary, "citation": method.citation, "options": options })
}
