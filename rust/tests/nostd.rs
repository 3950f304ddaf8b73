//! The core links without an allocator, and the link would notice one.
#![cfg(target_os = "linux")]

use std::path::Path;
use std::process::{Command, Output};

const TARGET: &str = concat!(env!("CARGO_TARGET_TMPDIR"), "/nostd");

fn build(features: &str) -> Output {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("rust/nostd/Cargo.toml");
    Command::new(env!("CARGO"))
        .args(["build", "--release", "--locked", "--target-dir", TARGET, "--features", features, "--manifest-path"])
        .arg(manifest)
        .output()
        .expect("cargo runs")
}

/// Both in one test: they share a target directory.
#[test]
fn the_core_needs_no_allocator_and_one_vec_breaks_the_link() {
    let plain = build("");
    assert!(plain.status.success(), "{}", String::from_utf8_lossy(&plain.stderr));
    let run = Command::new(Path::new(TARGET).join("release/physinc-nostd")).status().expect("it was built");
    assert_eq!(run.code(), Some(0), "the core answers wrongly without std");

    let with_vec = build("with_vec");
    let message = String::from_utf8_lossy(&with_vec.stderr);
    assert!(!with_vec.status.success() && message.contains("no global memory allocator"), "{message}");
}
