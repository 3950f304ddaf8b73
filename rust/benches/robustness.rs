//! What lost packets and noise cost: `cargo bench --bench robustness -- [SEEDS]`. Its small sister is a test, `rust/tests/robustness.rs`.

#[path = "../tests/judge/mod.rs"]
mod judge;

use judge::rms;
use judge::robustness::{LOSSES, NOISE, score};

/// Development looked at lower ones.
const FIRST_SEED: u64 = 9000;

fn main() {
    let seeds = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(10);
    println!("sim:bounce, seeds {FIRST_SEED} to {}: contacts found, false a minute, center rms\n", FIRST_SEED + seeds - 1);
    println!("| packets lost |{}", NOISE.map(|sigma| format!(" noise × {sigma} |")).concat());
    println!("|---|---|---|---|");
    for (name, faults) in LOSSES {
        let cell = |sigma| {
            let score = score(faults, sigma, FIRST_SEED, seeds, 6);
            let percent = 100.0 * score.matched as f64 / score.countable as f64;
            format!(" {percent:.1} %, {:.2}, {:.2} mm |", score.wrong as f64 / score.minutes, rms(&score.center) * 1e3)
        };
        println!("| {name} |{}", NOISE.map(cell).concat());
    }
}
