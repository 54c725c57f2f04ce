//! What both programs share: progress on the terminal, Ctrl-C, threads, exit codes.

use std::collections::BTreeMap;
use std::fmt::{Arguments, Display};
use std::io::{ErrorKind, IsTerminal, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use crate::base::error::{Kind, Result};
use crate::base::instructions::{self, InstructionSet};
use crate::base::observe::Observer;
use crate::base::par;
pub use crate::base::text::{bytes, counted, duration};

/// Options every command takes.
#[derive(Debug, Clone, clap::Args)]
pub struct Common {
    /// Worker threads; 0 means one per core. Results do not depend on it
    #[arg(long, default_value_t = 0, global = true)]
    pub threads: usize,
    /// Instruction set that is used, to measure or to test: avx512, avx2 or portable [default: that of the environment
    /// variable ENLIVEN_INSTRUCTIONS, else the best that the machine has]
    #[arg(long, global = true, value_name = "SET", hide_short_help = true)]
    pub instructions: Option<InstructionSet>,
    /// No progress and no notes
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

impl Common {
    /// Chooses the instruction set, starts the threads, catches Ctrl-C and returns the terminal's observer.
    ///
    /// # Errors
    /// When the machine does not have the instructions, or threads cannot be started.
    pub fn start(&self) -> Result<Terminal> {
        self.instructions.map_or(Ok(()), InstructionSet::choose)?;
        par::init(self.threads)?;
        let terminal = Terminal::new(self.quiet);
        let cancelled = Arc::clone(&terminal.cancelled);
        // A second Ctrl-C leaves at once: temporary files then stay, but nothing under a final name.
        let handler = move || {
            if cancelled.swap(true, Ordering::SeqCst) {
                std::process::exit(130);
            }
        };
        if ctrlc::set_handler(handler).is_err() {
            terminal.note("Ctrl-C cannot be caught here; interrupting will leave temporary files");
        }
        Ok(terminal)
    }
}

/// Prints progress bars and notes to standard error. Without a terminal, a line per stage longer than a second.
pub struct Terminal {
    quiet: bool,
    cancelled: Arc<AtomicBool>,
    bars: MultiProgress,
    open: Mutex<BTreeMap<String, ProgressBar>>,
}

impl Terminal {
    fn new(quiet: bool) -> Self {
        Self { quiet, cancelled: Arc::default(), bars: MultiProgress::new(), open: Mutex::default() }
    }

    fn with_bar(&self, stage: &str, act: impl FnOnce(&ProgressBar)) {
        if let Ok(open) = self.open.lock()
            && let Some(bar) = open.get(stage)
        {
            act(bar);
        }
    }
}

impl Observer for Terminal {
    fn begin(&self, stage: &str, total: u64) {
        if self.quiet || !std::io::stderr().is_terminal() {
            return;
        }
        let (bar, template) = if total > 0 {
            (ProgressBar::new(total), "{msg:28} {bar:30} {pos}/{len} {eta}")
        } else {
            (ProgressBar::new_spinner(), "{msg:28} {spinner} {elapsed}")
        };
        let bar = self.bars.add(bar);
        bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_message(stage.to_owned());
        bar.enable_steady_tick(Duration::from_millis(200));
        if let Ok(mut open) = self.open.lock()
            && let Some(old) = open.insert(stage.to_owned(), bar)
        {
            old.finish_and_clear();
        }
    }

    fn advance(&self, stage: &str, steps: u64) {
        self.with_bar(stage, |bar| bar.inc(steps));
    }

    fn end(&self, stage: &str, seconds: f64) {
        let bar = self.open.lock().ok().and_then(|mut open| open.remove(stage));
        if let Some(bar) = bar {
            bar.finish_and_clear();
        }
        if !self.quiet && seconds >= 1.0 {
            self.bars.suspend(|| complain(format_args!("{stage}: {seconds:.1} s")));
        }
    }

    fn note(&self, message: &str) {
        if !self.quiet {
            self.bars.suspend(|| complain(message));
        }
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::SeqCst)
    }
}

/// Reads the command line with `parse`, once it is sure that the environment asks for nothing wrong, and does `work`.
pub fn main<T>(parse: impl FnOnce() -> T, work: impl FnOnce(&T) -> Result<()>) -> ExitCode {
    let told = set_on_command_line(std::env::args_os().map(|word| word.to_string_lossy().into_owned()));
    exit(instructions::wanted().and_then(|set| told.unwrap_or(set).choose()).and_then(|()| work(&parse())))
}

/// The set that `--instructions` names, read before all else: `--version` tells the set in use and leaves while the other
/// options are still unread. A name that is none is left to the reader of options.
fn set_on_command_line(words: impl Iterator<Item = String>) -> Option<InstructionSet> {
    let mut words = words.take_while(|word| word != "--");
    while let Some(word) = words.next() {
        if word == "--instructions" {
            return words.next()?.parse().ok();
        }
        if let Some(name) = word.strip_prefix("--instructions=") {
            return name.parse().ok();
        }
    }
    None
}

/// Prints an error as one line and turns a result into the process's exit code.
pub fn exit(result: Result<()>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Who stopped a run need not be told of an error.
            let prefix = if error.kind() == Kind::Interrupted { "" } else { "error: " };
            complain(format_args!("{prefix}{error}"));
            ExitCode::from(error.exit_code())
        }
    }
}

/// Writes a line to standard error. When nobody reads it any more there is nobody to tell.
fn complain(line: impl Display) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Writes a line of results to standard output; a reader that has gone (`| head`) has seen what it wanted.
pub fn write_line(line: Arguments) {
    if let Err(error) = writeln!(std::io::stdout(), "{line}")
        && error.kind() != ErrorKind::BrokenPipe
    {
        complain(format_args!("error: standard output: cannot write: {error}"));
        std::process::exit(1);
    }
}

/// [`write_line`], formatted as by `println!`.
#[macro_export]
macro_rules! say {
    ($($part:tt)*) => { $crate::cli::common::write_line(format_args!($($part)*)) };
}
pub use say;

/// Width of the terminal that results go to, in columns; none where they go elsewhere.
pub fn columns() -> Option<usize> {
    console::Term::stdout().size_checked().map(|(_, columns)| columns.into())
}

/// The words of a text in lines of at most `width` characters; a longer word has a line of its own.
pub fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => *line = format!("{line} {word}"),
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
