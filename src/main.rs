//! `enliven`: animates a still picture of water, fire or smoke.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use enliven::base::error::Result;
use enliven::base::instructions::version;
use enliven::cli::common::{self, Common};
use enliven::cli::{animate, compare, demo, measure, methods, simulate};

/// Bring a still picture of water, fire or smoke to life.
#[derive(Parser)]
#[command(version = version(), arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    common: Common,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Demo),
    Animate(Box<animate::Animate>),
    Compare(Box<compare::Compare>),
    Measure(measure::Measure),
    Methods(methods::Methods),
    Simulate(simulate::Simulate),
}

fn run(cli: &Cli) -> Result<()> {
    let terminal = cli.common.start()?;
    match &cli.command {
        Command::Demo(command) => command.run(&terminal),
        Command::Animate(command) => command.run(&terminal),
        Command::Compare(command) => command.run(&terminal),
        Command::Measure(command) => command.run(&terminal),
        Command::Methods(command) => command.run(),
        Command::Simulate(command) => command.run(&terminal),
    }
}

fn main() -> ExitCode {
    common::main(Cli::parse, run)
}
