//! Tracks of many balls against their truth: `cargo bench --bench tracks -- [SEEDS] [FIRST_SEED] [SCENE…]`.

#[path = "../tests/judge/mod.rs"]
mod judge;

use judge::identity::Identities;
use judge::{config, run};
use physinc::config::Method;
use physinc::sim::Scene;

/// Development looked at lower ones.
const FIRST_SEED: u64 = 9000;

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let number = |i: usize, or: u64| args.get(i).and_then(|a| a.parse().ok()).unwrap_or(or);
    let (seeds, first) = (number(0, 50), number(1, FIRST_SEED));
    let told: Vec<&str> = args.iter().skip(2).map(String::as_str).collect();
    let scenes = if told.is_empty() { &["many?balls=8", "many?balls=10", "many?balls=8&loss=0.1"][..] } else { &told };
    println!("seeds {first} to {}\n\n{}", first + seeds - 1, Identities::HEAD);
    for name in scenes {
        let mut sum = Identities::default();
        for seed in first..first + seeds {
            let scene = Scene::parse(&format!("{name}&seed={seed}")).expect("a scene");
            let (events, _) = run(&scene, &config(&scene, Method::Best));
            let before = sum.clone();
            sum.add(&events, scene.truth());
            if sum.swapped > before.swapped {
                eprintln!("{name}&seed={seed}: swapped");
            }
        }
        println!("{}", sum.row(name));
    }
}
