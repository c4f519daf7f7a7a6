//! `docs/cli.md` is what the flags say. Renew it with `RENEW=1 cargo test --test cli_reference`.

use std::path::Path;

use clerestory::cli::{pages, settings};

#[test]
fn the_reference_is_what_the_flags_say() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/cli.md");
    let now = pages::reference(&settings::command());
    if std::env::var_os("RENEW").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, &now).unwrap();
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(written == now, "docs/cli.md differs from the flags: renew it as the top of this test says");
}
