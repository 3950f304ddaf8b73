//! Active or passive: false alarms and detection beside the paper's θ, `cargo bench --bench activity -- [TRACKS]`; what
//! `physics::sequential::OF_LOOSE` rests on, `cargo bench --bench activity -- calibrate [TRACKS]`.

#[path = "../tests/throws/mod.rs"]
mod throws;

use physinc::config::{LawName, LawsConfig, Method, ObjectConfig};
use physinc::math::{Vec3, chi2_3_sf};
use physinc::physics::gravity::Gravity;
use physinc::physics::law::FreeFallWithDrag;
use physinc::physics::onset::Side;
use physinc::track::hypothesis::Surroundings;
use physinc::track::passive::{Circumstances, Mode};
use throws::{Throw, first_active};

/// Calibration used the seeds below this.
const FIRST_SEED: u64 = 1_000_000;

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let number = |i: usize, or: u64| args.get(i).and_then(|a| a.parse().ok()).unwrap_or(or);
    if args.first().is_some_and(|a| a == "calibrate") {
        calibrate(number(1, 200_000));
    } else {
        table(number(0, 20_000));
    }
}

/// The largest ratio of each passive track, and what makes 0.95 of the stated tracks alarm.
fn calibrate(tracks: u64) {
    let law = FreeFallWithDrag::of(&ObjectConfig::default(), &LawsConfig::default(), 0.033);
    let gravity = Gravity::known(Vec3::new(0.0, 0.0, -9.81));
    let around = Surroundings { law: &law, gravity: &gravity, duration: 0.0045, normal_at: &|_| None, beyond: &|_| false };
    let place = Circumstances {
        around: &around,
        law: LawName::FreeFall,
        nearest: &|_| None,
        closed: true,
        open: &|_, _| false,
        radius: 0.033,
        any_shape: false,
        untold: None,
    };
    let largest = |seed: u64| {
        let samples = Throw::new(seed).samples(20, None);
        let ratio = |n: usize| place.explain(Mode::Falling, &samples[..n], Side::After).map_or(0.0, |e| e.onset.chi2);
        (3..=20).map(ratio).fold(0.0, f64::max)
    };
    let mut sorted: Vec<f64> = (0..tracks).map(largest).collect();
    sorted.sort_unstable_by(|a, b| b.total_cmp(a));
    println!("| false alarms a track | χ² exceeded by 0.95 of that | multiplicity |\n|---|---|---|");
    for rate in [1e-2, 3e-3, 1e-3, 3e-4] {
        let exceeded = sorted[(0.95 * rate * tracks as f64) as usize];
        println!("| {rate} | {exceeded:.2} | {:.3} |", 0.045 * rate / chi2_3_sf(exceeded));
    }
}

fn table(tracks: u64) {
    println!("20 positions at 30 Hz as of a ball at 1.5 m, seeds from {FIRST_SEED}; onset of the acceleration from frame 6 to 9\n");
    println!("| acceleration m/s² | method | tracks | active | median delay, frames |\n|---|---|---|---|---|");
    for (method, name) in [(Method::Best, "best"), (Method::Paper, "paper")] {
        for (acceleration, count) in [(0.0, tracks), (0.5, tracks / 10), (1.0, tracks / 10), (2.0, tracks / 10)] {
            let first = |seed: u64| {
                let throw = Throw::new(FIRST_SEED + seed);
                let onset = (acceleration > 0.0).then_some(acceleration);
                first_active(&throw, 20, onset, method).map(|frame| frame - f64::from(throw.onset))
            };
            let mut delays: Vec<f64> = (0..count).filter_map(first).collect();
            delays.sort_unstable_by(f64::total_cmp);
            let active = delays.len();
            let median = if acceleration > 0.0 && active > 0 { format!("{:.0}", delays[active / 2]) } else { "–".to_owned() };
            println!("| {acceleration} | {name} | {count} | {active} ({:.3} %) | {median} |", 100.0 * active as f64 / count as f64);
        }
    }
}
