//! Contacts that never were, and surfaces that are none, where balls bounce badly or are seen badly:
//! `cargo bench --bench soundness -- [SEEDS] [FIRST_SEED] [SCENE…]`.

#[path = "../tests/judge/mod.rs"]
mod judge;

use judge::{MATCH_NS, config, countable, finals, run};
use physinc::config::Method;
use physinc::event::{Contact, Event, Kind, Surface};
use physinc::math::{Mat3, Vec3};
use physinc::sim::Scene;
use physinc::sim::truth::{ContactTruth, Truth};
use std::cmp::Reverse;
use std::collections::HashSet;

const SEEDS: u64 = 30;
/// Development looked at lower ones.
const FIRST_SEED: u64 = 33_000;

const SCENES: [&str; 9] = [
    "bounce?restitution=0.45",
    "bounce?restitution=0.5&spin_sd=40",
    "bounce?restitution=0.5&loss=0.25",
    "bounce?restitution=0.5&sigma=1.5",
    "room?restitution=0.5",
    "drop?restitution=0.5",
    "roll?restitution=0.5",
    "two_balls?restitution=0.5",
    "many?restitution=0.55",
];

/// A contact is wrong that is farther from each that happened than this, m, and than so many standard deviations.
const FAR: (f64, f64) = (0.008, 6.0);
/// A surface is none that is farther from each true one than this where it was touched, m, or tilted by more degrees; or that is one with more
/// contacts over again.
const ANOTHER: (f64, f64) = (0.02, 10.0);

/// Sums over scenes.
#[derive(Default)]
struct Soundness {
    /// Contacts that could be found, and those that were.
    countable: usize,
    found: usize,
    /// Contacts and surfaces that were told.
    contacts: usize,
    wrong: usize,
    surfaces: usize,
    none: usize,
}

fn is_right(told: &Contact, happened: &ContactTruth) -> bool {
    let off = Vec3::from(told.center) - Vec3::from(happened.center);
    let covariance = Mat3::from_fn(|i, j| told.covariance[i][j]);
    let within = off.norm() < FAR.0 || covariance.try_inverse().is_some_and(|i| off.dot(&(i * off)) < FAR.1 * FAR.1);
    (told.time_ns - happened.time_ns).abs() < MATCH_NS && within
}

/// Which face of the scene a surface is.
fn face(told: &Surface, truth: &Truth) -> Option<usize> {
    let outline = told.outline.iter().flatten().map(|p| Vec3::from(*p));
    let middle = outline.clone().sum::<Vec3>() / outline.count().max(1) as f64;
    truth.surfaces.iter().position(|face| {
        let normal = Vec3::from(face.normal);
        (normal.dot(&middle) - face.offset).abs() < ANOTHER.0 && normal.angle(&Vec3::from(told.normal)).to_degrees() < ANOTHER.1
    })
}

impl Soundness {
    const HEAD: &str = "| scene | found | contacts told | wrong | surfaces told | none |\n|---|---|---|---|---|---|";

    /// Adds what was told of a scene whose pose is told; says which contacts are wrong.
    fn add(&mut self, name: &str, events: &[Event], truth: &Truth) {
        let contacts = finals!(events, Contact);
        for (happened, _) in truth.contacts.iter().zip(countable(truth)).filter(|(_, countable)| *countable) {
            self.countable += 1;
            self.found += usize::from(contacts.iter().any(|(_, contact)| is_right(contact, happened)));
        }
        for (event, contact) in contacts {
            self.contacts += 1;
            if !truth.contacts.iter().any(|happened| is_right(contact, happened)) {
                self.wrong += 1;
                eprintln!("{name}: track {} contact {} at {:.3} s", event.track.unwrap_or(0), contact.id, contact.time_ns as f64 * 1e-9);
            }
        }
        let mut surfaces: Vec<&Surface> =
            finals!(events, Surface).into_iter().map(|(_, s)| s).filter(|s| s.merged_into.is_none()).collect();
        surfaces.sort_by_key(|surface| Reverse(surface.contacts));
        let mut faces = HashSet::new();
        for surface in surfaces {
            self.surfaces += 1;
            if !face(surface, truth).is_some_and(|face| faces.insert(face)) {
                self.none += 1;
                eprintln!("{name}: surface {} of {} contacts", surface.id, surface.contacts);
            }
        }
    }

    fn row(&self, name: &str) -> String {
        let Self { countable, found, contacts, wrong, surfaces, none } = self;
        format!("| {name} | {found}/{countable} | {contacts} | {wrong} | {surfaces} | {none} |")
    }
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let number = |i: usize, or: u64| args.get(i).and_then(|a| a.parse().ok()).unwrap_or(or);
    let (seeds, first) = (number(0, SEEDS), number(1, FIRST_SEED));
    let told: Vec<&str> = args.iter().skip(2).map(String::as_str).collect();
    println!("seeds {first} to {}\n\n{}", first + seeds - 1, Soundness::HEAD);
    let mut all = Soundness::default();
    for name in if told.is_empty() { &SCENES[..] } else { &told } {
        let mut sum = Soundness::default();
        for seed in first..first + seeds {
            let name = format!("{name}&pose=1&seed={seed}");
            let scene = match Scene::parse(&name) {
                Ok(scene) => scene,
                // Not every seed finds throws that touch what they should.
                Err(why) => {
                    eprintln!("{name}: {why}");
                    continue;
                }
            };
            let (events, _) = run(&scene, &config(&scene, Method::Best));
            sum.add(&name, &events, scene.truth());
        }
        println!("{}", sum.row(name));
        all.countable += sum.countable;
        all.found += sum.found;
        all.contacts += sum.contacts;
        all.wrong += sum.wrong;
        all.surfaces += sum.surfaces;
        all.none += sum.none;
    }
    println!("{}", all.row("all"));
}
