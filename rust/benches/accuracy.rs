//! Accuracy on simulated scenes, against their truth: `make measures`.

#[path = "../tests/judge/mod.rs"]
mod judge;

use judge::Score;
use physinc::config::Method;

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let (seeds, only) = (args.first().and_then(|a| a.parse().ok()).unwrap_or(10u64), args.get(1).cloned().unwrap_or_default());
    for (name, extra) in [
        ("touch 0 ms", "contact_duration=0"),
        ("touch 4.5 ms", "contact_duration=0.0045"),
        ("27° of unknown tilt", "tilt_deg=27"),
        ("25 % of frames missing", "loss=0.25"),
        ("σ × 1.5", "sigma=1.5"),
        ("white noise", "white=1"),
        ("5×5 window", "window=5"),
        ("f + 1 %", "focal_factor=1.01"),
    ] {
        for method in [Method::Best, Method::Paper] {
            let label = format!("{name}{}", if method == Method::Paper { ", paper" } else { "" });
            if !label.contains(&only) {
                continue;
            }
            let mut score = Score::default();
            for seed in 0..seeds {
                let distance = 1.5 + 0.5 * (seed as f64 + 0.5) / seeds as f64;
                score.add(&format!("bounce?seed={}&distance={distance}&{extra}", 100 + seed), method);
            }
            println!("{label}: {}", score.line());
        }
    }
}
