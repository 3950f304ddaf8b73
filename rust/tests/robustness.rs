//! Loss × noise, as a table that must not change unnoticed. `PHYSINC_BLESS=1 cargo test --test robustness` writes it anew.

mod judge;

use judge::rms;
use judge::robustness::{LOSSES, NOISE, score};
use std::path::Path;

/// Error to half millimetres: processors differ in the last bits of a sine, and those may turn a rounded sample.
fn halves_mm(error: f64) -> f64 {
    (error * 2e3).round() * 0.5
}

/// One line of the table.
fn row(name: &str, faults: &str) -> String {
    let cell = |sigma| {
        let score = score(faults, sigma, 200, 2, 3);
        let error = halves_mm(rms(&score.center));
        format!(" {}/{}, {} false, {error:.1} mm |", score.matched, score.countable, score.wrong)
    };
    format!("| {name} |{}\n", NOISE.map(cell).concat())
}

#[test]
fn loss_and_noise_cost_what_the_table_says() {
    let noise = NOISE.map(|sigma| format!(" noise × {sigma} |")).concat();
    let head = format!(
        "Contacts found of those that could be, false ones, center rms to 0.5 mm; two scenes of three throws.\n\n| packets lost |{noise}\n|---|---|---|---|\n"
    );
    let rows: Vec<String> = std::thread::scope(|scope| {
        let rows = LOSSES.map(|(name, faults)| scope.spawn(move || row(name, faults)));
        rows.into_iter().map(|row| row.join().expect("a row")).collect()
    });
    let table = head + &rows.concat();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("rust/tests/snapshots/robustness.md");
    if std::env::var_os("PHYSINC_BLESS").is_some() {
        std::fs::write(&path, &table).expect("a file");
    }
    assert_eq!(table, std::fs::read_to_string(path).expect("it is there"));
}
