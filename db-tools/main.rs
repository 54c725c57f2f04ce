//! `enliven-db`: builds libraries of fluid clips, and shows what is in them.

mod build;
mod gallery;
mod inspect;
mod scan;
mod scenes;
mod verify;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use enliven::base::error::Result;
use enliven::base::instructions::version;
use enliven::cli::common::{self, Common};

/// Build and look after libraries of fluid clips for enliven.
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
    Scan(scan::Scan),
    Build(build::Build),
    Inspect(inspect::Inspect),
    Scenes(scenes::Scenes),
    Verify(verify::Verify),
    Gallery(gallery::Gallery),
}

fn run(cli: &Cli) -> Result<()> {
    let terminal = cli.common.start()?;
    match &cli.command {
        Command::Scan(command) => command.run(&terminal),
        Command::Build(command) => command.run(&terminal),
        Command::Inspect(command) => command.run(&terminal),
        Command::Scenes(command) => command.run(&terminal),
        Command::Verify(command) => command.run(&terminal),
        Command::Gallery(command) => command.run(&terminal),
    }
}

fn main() -> ExitCode {
    common::main(Cli::parse, run)
}
