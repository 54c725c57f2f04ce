//! What needs other processes: our two programs as a person meets them, and a browser that shows what they made.

mod browser;
mod chromium;
mod cli;
#[allow(dead_code, reason = "the programs make their own options")]
#[path = "../common/mod.rs"]
mod common;
mod compare;
mod compare_blind;
mod compare_page;
mod instructions;
