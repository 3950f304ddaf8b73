//! Who uses a device.

use std::format;
use std::path::Path;
use std::string::String;

/// The programs that have the file `node` open, as far as the system tells: `cheese (process 4711)`.
pub(super) fn holders(node: &str) -> std::vec::Vec<String> {
    let node = std::fs::read_link(node).unwrap_or_else(|_| node.into());
    let own = format!("{}", std::process::id());
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    processes
        .filter(|process| process.file_name().to_string_lossy().bytes().all(|b| b.is_ascii_digit()))
        .filter(|process| process.file_name().to_string_lossy() != own && has_open(&process.path(), &node))
        .map(|process| {
            let name = std::fs::read_to_string(process.path().join("comm")).unwrap_or_default();
            format!("{} (process {})", name.trim(), process.file_name().to_string_lossy())
        })
        .collect()
}

/// Whether the process at `/proc/N` has the file open.
fn has_open(process: &Path, node: &Path) -> bool {
    let files = std::fs::read_dir(process.join("fd")).into_iter().flatten().flatten();
    files.filter_map(|file| std::fs::read_link(file.path()).ok()).any(|file| file == node)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_has_a_file_open_is_named() {
        let path = std::env::temp_dir().join(format!("physinc-held-{}", std::process::id()));
        let file = std::fs::File::create(&path).unwrap();
        let mut sleeper = std::process::Command::new("sleep").arg("60").stdin(file).spawn().unwrap();
        let found = holders(&path.to_string_lossy());
        let nobody = holders("/dev/bus/usb/999/999");
        sleeper.kill().unwrap();
        let id = sleeper.id();
        sleeper.wait().unwrap();
        std::fs::remove_file(&path).unwrap();
        // Between fork and exec it still bears the name of this program.
        assert!(found.len() == 1 && found[0].ends_with(&format!("(process {id})")), "{found:?}");
        assert!(nobody.is_empty());
    }
}
