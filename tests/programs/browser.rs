//! Chromium without a window, as far as a page can tell about itself by logging.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Longest wait for the browser.
const PATIENCE: Duration = Duration::from_secs(60);

/// Ends the browser, however the test ends.
struct Browser(Child);

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(page: &Path, folder: &Path, (width, height): (usize, usize)) -> Option<Browser> {
    let page = format!("file://{}", page.display());
    let profile = format!("--user-data-dir={}", folder.join("profile").display());
    let size = format!("--window-size={width},{height}");
    let mut command = Command::new("chromium");
    command.args(["--headless", "--no-sandbox", "--disable-quic", "--no-first-run"]);
    command.args(["--disable-background-networking", "--disable-component-update", "--disable-sync"]);
    // Colours as on a machine with a graphics card, without one.
    command.args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]);
    command.args(["--enable-gpu-rasterization"]);
    command.args(["--allow-file-access-from-files", "--autoplay-policy=no-user-gesture-required"]);
    command.args(["--enable-logging=stderr", "--v=0", &size, &profile, &page]);
    let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    match child {
        Ok(child) => Some(Browser(child)),
        Err(error) => {
            println!("skipped: chromium does not start ({error})");
            None
        }
    }
}

/// What a page in a window of so many pixels logs as `RESULT … .`, until `RESULT end .` or the end of our patience. None,
/// saying why, where there is no Chromium that can play our videos; `folder` is for what the browser writes.
pub fn results(page: &Path, folder: &Path, size: (usize, usize)) -> Option<Vec<String>> {
    let results = logged(&mut start(page, folder, size)?);
    if results.is_empty() {
        println!("skipped: chromium said nothing in {} s", PATIENCE.as_secs());
        return None;
    }
    if results[0].starts_with("codec") {
        println!("skipped: this chromium has no H.264 decoder");
        return None;
    }
    Some(results)
}

fn logged(browser: &mut Browser) -> Vec<String> {
    let stderr = browser.0.stderr.take().unwrap();
    let (send, receive) = mpsc::channel();
    std::thread::spawn(move || {
        for line in BufReader::new(stderr).lines().map_while(Result::ok) {
            let result = line.split_once("RESULT ").and_then(|(_, rest)| rest.split_once(" ."));
            if let Some((result, _)) = result
                && send.send(result.to_string()).is_err()
            {
                break;
            }
        }
    });
    let end = Instant::now() + PATIENCE;
    let mut results = Vec::new();
    while let Ok(result) = receive.recv_timeout(end.saturating_duration_since(Instant::now())) {
        if result == "end" {
            break;
        }
        results.push(result);
    }
    results
}
