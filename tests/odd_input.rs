//! Files as people have them, through the program itself: names that are no text, ends of lines of every
//! machine, materials that other programs write, pipes where files should be.

mod support;

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A closed room of 4 x 3 x 2.6 m, wound inwards: its ceiling, its floor and its walls have a material each.
fn room(mtllib: &[u8], [ceiling, floor, wall]: [&[u8]; 3]) -> Vec<u8> {
    let mut obj = b"mtllib ".to_vec();
    obj.extend_from_slice(mtllib);
    obj.extend_from_slice(b"\nv 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nv 0 0 2.6\nv 4 0 2.6\nv 4 3 2.6\nv 0 3 2.6\n");
    for (name, faces) in
        [(ceiling, "f 5 8 7 6\n"), (floor, "f 1 2 3 4\n"), (wall, "f 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n")]
    {
        obj.extend_from_slice(&[b"usemtl ", name, b"\n", faces.as_bytes()].concat());
    }
    obj
}

const PLAIN: [&[u8]; 3] = [b"lamp", b"floor", b"wall"];

fn materials([ceiling, floor, wall]: [&[u8]; 3]) -> Vec<u8> {
    [b"newmtl ", ceiling, b"\nKd 0\nKe 20\nnewmtl ", floor, b"\nKd 0.2\nnewmtl ", wall, b"\nKd 0.7\n"].concat()
}

fn write(dir: &Path, name: impl AsRef<OsStr>, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = dir.join(name.as_ref());
    std::fs::write(&path, bytes).unwrap();
    path
}

fn clerestory<S: AsRef<OsStr>>(dir: &Path, args: impl IntoIterator<Item = S>) -> Output {
    Command::new(env!("CARGO_BIN_EXE_clerestory")).args(args).current_dir(dir).output().unwrap()
}

fn said(out: &Output) -> String {
    String::from_utf8(out.stderr.clone()).expect("what the program says is text")
}

/// Bytes of the segments in which materials and geometry lie, of a model ingested by itself.
fn stored(dir: &Path, model: &Path) -> Vec<(OsString, Vec<u8>)> {
    let store = dir.join("of-test.clr");
    let _ = std::fs::remove_dir_all(&store);
    let out = clerestory(dir, [OsStr::new("ingest"), store.as_os_str(), model.as_os_str()]);
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let segments = std::fs::read_dir(store.join("segments")).unwrap().map(|e| e.unwrap().path());
    let mut all: Vec<_> = segments.map(|p| (p.file_name().unwrap().to_owned(), std::fs::read(&p).unwrap())).collect();
    all.sort();
    all
}

/// The same room with plain names and LF.
fn plain(dir: &Path) -> Vec<(OsString, Vec<u8>)> {
    write(dir, "plain.mtl", materials(PLAIN));
    stored(dir, &write(dir, "plain.obj", room(b"plain.mtl", PLAIN)))
}

#[test]
fn names_that_differ_in_one_byte_that_is_no_text_are_different_materials() {
    let dir = tempfile::tempdir().unwrap();
    let names: [&[u8]; 3] = [b"Lampe", b"Mur \xe8", b"Mur \xe9"];
    write(dir.path(), OsStr::from_bytes(b"mat\xe9riaux.mtl"), materials(names));
    let model = write(dir.path(), "latin1.obj", room(b"mat\xe9riaux.mtl", names));
    assert!(stored(dir.path(), &model) == plain(dir.path()), "other light than with plain names");
}

#[test]
fn the_catalogue_keeps_names_and_paths_so_that_different_bytes_stay_different() {
    let dir = tempfile::tempdir().unwrap();
    let faces = ["f 1 2 3 4\n", "f 5 8 7 6\n", "f 1 5 6 2\n"];
    let names: [&[u8]; 3] = [b"caf\xe9", b"caf\xe8", br"caf\xe9"];
    let mut obj = b"v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nv 0 0 2.6\nv 4 0 2.6\nv 4 3 2.6\nv 0 3 2.6\n".to_vec();
    for (name, face) in names.iter().zip(faces) {
        obj.extend_from_slice(&[b"o ", *name, b"\n", face.as_bytes()].concat());
    }
    let model = write(dir.path(), OsStr::from_bytes(b"m\xe9.obj"), obj);
    let out = clerestory(dir.path(), [OsStr::new("ingest"), OsStr::new("s.clr"), model.as_os_str()]);
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let catalogue = rusqlite::Connection::open(dir.path().join("s.clr/scene.sqlite")).unwrap();
    let texts = |sql: &str| -> Vec<String> {
        catalogue.prepare(sql).unwrap().query_map([], |r| r.get(0)).unwrap().map(Result::unwrap).collect()
    };
    let stored = texts("SELECT name FROM objects ORDER BY id");
    assert_eq!(stored, [r"caf\xe9", r"caf\xe8", r"caf\\xe9"]);
    assert!(texts("SELECT path FROM input_files")[0].ends_with(r"/m\xe9.obj"));
}

#[test]
fn an_index_beyond_every_file_costs_its_face_alone_and_names_its_line() {
    let dir = tempfile::tempdir().unwrap();
    plain(dir.path());
    let mut obj = room(b"plain.mtl", PLAIN);
    let line = obj.split(|b| *b == b'\n').count();
    obj.extend_from_slice(b"f 1 2 99999999999\nf 1 2 4294967297\nf 1/99999999999/1 2 3\nf 1 2 99999999999999999999\n");
    write(dir.path(), "far.obj", obj);
    let out = clerestory(dir.path(), ["ingest", "s.clr", "far.obj", "--json"]);
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let summary: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&summary["skipped"]["bad_face"], &summary["patches"]), (&4.into(), &6.into()));
    assert!(said(&out).contains(&format!("4 faces skipped, first far.obj:{line}: ")), "{}", said(&out));
}

#[test]
fn every_end_of_a_line_gives_the_same_model() {
    let dir = tempfile::tempdir().unwrap();
    let expected = plain(dir.path());
    for (name, end) in [("cr", "\r"), ("crlf", "\r\n")] {
        let with = |text: Vec<u8>| String::from_utf8(text).unwrap().replace('\n', end);
        write(dir.path(), format!("{name}.mtl"), with(materials(PLAIN)));
        let library = format!("{name}.mtl");
        let model = write(dir.path(), format!("{name}.obj"), with(room(library.as_bytes(), PLAIN)));
        assert!(stored(dir.path(), &model) == expected, "{name}");
    }
}

#[test]
fn a_material_file_is_found_in_quotes_and_beside_the_model() {
    let dir = tempfile::tempdir().unwrap();
    let expected = plain(dir.path());
    write(dir.path(), "Floor 1.mtl", materials(PLAIN));
    for (library, warned) in
        [(&br#""Floor 1.mtl""#[..], false), (br"C:\Users\me\my files\PLAIN.MTL", true), (b"/home/me/floor 1.mtl", true)]
    {
        let model = write(dir.path(), "there.obj", room(library, PLAIN));
        assert!(stored(dir.path(), &model) == expected, "{library:?}");
        let out = clerestory(
            dir.path(),
            [OsStr::new("ingest"), OsStr::new("x.clr"), model.as_os_str(), OsStr::new("--fresh")],
        );
        assert_eq!(said(&out).contains("is not there: "), warned, "{}", said(&out));
    }
}

#[test]
fn folders_models_and_stores_may_have_names_that_are_no_text() {
    let dir = tempfile::tempdir().unwrap();
    let here = dir.path().join(OsStr::from_bytes(b"b\xe2timent $(x)"));
    std::fs::create_dir(&here).unwrap();
    write(&here, OsStr::from_bytes(b"\xe9.mtl"), materials(PLAIN));
    let model = write(&here, OsStr::from_bytes(b"mod\xe8le 'a'.obj"), room(b"\xe9.mtl", PLAIN));
    let store = here.join(OsStr::from_bytes(b"d\xe9p\xf4t.clr"));
    let run = |args: &[&OsStr]| {
        let out = clerestory(dir.path(), args);
        assert_eq!(out.status.code(), Some(0), "{args:?}: {}", said(&out));
        serde_json::from_slice::<serde_json::Value>(&out.stdout).unwrap_or_default()
    };
    let word = OsStr::new;
    let json = word("--json");
    let materials = here.join(OsStr::from_bytes(b"\xe9.mtl"));
    let done = run(&[
        word("run"),
        model.as_os_str(),
        word("--store"),
        store.as_os_str(),
        word("--quality"),
        word("preview"),
        word("--materials"),
        materials.as_os_str(),
        json,
    ]);
    assert!(done["store"].as_str().unwrap().ends_with("d\\xe9p\\xf4t.clr"), "{}", done["store"]);
    assert_eq!(done["converged"], true);
    assert_eq!(
        run(&[word("ingest"), store.as_os_str(), model.as_os_str(), word("--materials"), materials.as_os_str(), json])
            ["unchanged"],
        true
    );
    for verb in ["status", "check"] {
        run(&[word(verb), store.as_os_str(), json]);
    }
    let points = write(&here, OsStr::from_bytes(b"p\xff.csv"), "x,y,z,nx,ny,nz\n1.5,1.5,0,0,0,1\n");
    let answers = here.join(OsStr::from_bytes(b"a\xff.csv"));
    let sample = [
        word("sample"),
        store.as_os_str(),
        word("--points"),
        points.as_os_str(),
        word("-o"),
        answers.as_os_str(),
        json,
    ];
    assert_eq!(run(&sample)["answered"], 1);
    for name in [&b"x\xff.csv"[..], b"x\xff.ply", b"x\xff.glb"] {
        let file = here.join(OsStr::from_bytes(name));
        let files = run(&[word("export"), store.as_os_str(), word("-o"), file.as_os_str(), json]);
        assert!(files["files"][0].as_str().unwrap().contains("x\\xff."), "{files}");
        assert!(file.is_file());
    }
}

#[test]
fn nothing_in_a_model_sends_escape_codes_to_a_terminal() {
    let dir = tempfile::tempdir().unwrap();
    let evil: [&[u8]; 3] = [b"\x1b[31mlamp", b"\xc2\x9b2J", b"wall\x07"];
    write(
        dir.path(),
        "evil.mtl",
        [b"newmtl \x1b[31mlamp\nKd 1\nKe nan\nKs 1\nmap_\x1b[1m x\n".to_vec(), materials(evil)].concat(),
    );
    let mut obj = room(b"evil.mtl no\x1b[2J.mtl", evil);
    obj.extend_from_slice(b"usemtl \x1b]0;x\nf 1 2 \x1b[7m\nf 1 2 3\n");
    let model = write(dir.path(), OsStr::from_bytes(b"\x1b[5m.obj"), obj);
    for json in [&[][..], &[OsStr::new("--json")]] {
        let out =
            clerestory(dir.path(), [&[OsStr::new("ingest"), OsStr::new("\x1b.clr"), model.as_os_str()], json].concat());
        assert_eq!(out.status.code(), Some(0), "{}", said(&out));
        let all = [out.stdout.clone(), out.stderr.clone()].concat();
        let steering = String::from_utf8(all).unwrap().chars().find(|c| c.is_control() && *c != '\n');
        assert_eq!(steering, None, "{}", said(&out));
        let _ = std::fs::remove_dir_all(dir.path().join("\x1b.clr"));
    }
    let out = clerestory(dir.path(), [OsStr::new("ingest"), OsStr::new("s.clr"), OsStr::new("\x1b[1m\u{202e}.obj")]);
    assert!(said(&out).starts_with("error: \\u{1b}[1m\\u{202e}.obj: "), "{}", said(&out));
}

#[test]
fn only_names_and_colours_can_make_a_material_file_unreadable_and_run_says_where() {
    let dir = tempfile::tempdir().unwrap();
    let model = write(dir.path(), "a.obj", room(b"a.mtl", PLAIN));
    let noise = "Ns x\nillum\nd\nmap_Kd \nmap_Bump -bm\nTf spectral x 1\nKa\nKs 1 2\nNi 1 1 1\nsharpness q\n\0\n";
    write(dir.path(), "a.mtl", format!("{noise}{}{noise}", String::from_utf8(materials(PLAIN)).unwrap()));
    assert!(stored(dir.path(), &model) == plain(dir.path()), "noise changes the light");
    for (line, what) in [
        ("Kd 0.5 0.5", "2 of 3"),
        ("Ke spectral x.rfl", "`Ke spectral`"),
        ("Kd xyz 1 1 1", "`Kd xyz`"),
        ("Kd 0,5", "`0,5`"),
    ] {
        write(dir.path(), "a.mtl", format!("newmtl wall\r\n\r\n{line}\r\n"));
        for verb in [&["ingest", "s.clr", "a.obj"][..], &["run", "a.obj", "--store", "s.clr"]] {
            let out = clerestory(dir.path(), verb);
            let said = said(&out);
            assert_eq!(out.status.code(), Some(1), "{said}");
            let error = said.lines().find(|l| l.starts_with("error: ")).unwrap();
            assert!(error.contains("a.mtl:3: ") && error.contains(what), "{error}");
            assert!(said.contains("\nhelp: write"), "{said}");
        }
    }
}

#[test]
fn a_file_without_faces_is_said_and_does_not_hide_behind_another() {
    let dir = tempfile::tempdir().unwrap();
    plain(dir.path());
    write(dir.path(), "points.obj", "v 0 0 0\nv 1 0 0\np 1 2\n");
    for models in [["plain.obj", "points.obj"], ["points.obj", "plain.obj"]] {
        let out = clerestory(dir.path(), [&["ingest", "s.clr"][..], &models, &["--fresh"]].concat());
        assert_eq!(out.status.code(), Some(0), "{}", said(&out));
        assert!(said(&out).contains("warning: points.obj: the file holds no face"), "{}", said(&out));
        assert!(!said(&out).contains("plain.obj: the file holds"), "{}", said(&out));
    }
    let out = clerestory(dir.path(), ["ingest", "t.clr", "points.obj"]);
    assert!(out.status.code() == Some(1) && said(&out).starts_with("error: points.obj: no face"), "{}", said(&out));
}

#[test]
fn a_pipe_is_refused_wherever_a_file_is_named() {
    let dir = tempfile::tempdir().unwrap();
    plain(dir.path());
    assert!(Command::new("mkfifo").arg(dir.path().join("pipe")).status().unwrap().success());
    write(dir.path(), "of-pipe.obj", room(b"pipe", PLAIN));
    for line in [
        "ingest a.clr pipe",
        "ingest a.clr of-pipe.obj",
        "ingest a.clr plain.obj --materials pipe",
        "run of-pipe.obj",
        "sample of-test.clr --points pipe -o x.csv",
    ] {
        let started = Instant::now();
        let out = clerestory(dir.path(), line.split(' '));
        let said = said(&out);
        assert!(out.status.code() == Some(1) && said.contains("error: ") && said.contains("pipe"), "{line}: {said}");
        assert!(started.elapsed() < Duration::from_secs(10), "{line}");
    }
}

#[test]
fn a_face_of_a_million_corners_is_skipped_with_its_line_and_the_limit() {
    let dir = tempfile::tempdir().unwrap();
    plain(dir.path());
    let mut obj = String::from_utf8(room(b"plain.mtl", PLAIN)).unwrap();
    let n = 1_000_000;
    for i in 0..n {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(n);
        obj += &format!("v {:.6} {:.6} 1\n", angle.cos(), angle.sin());
    }
    let line = obj.lines().count() + 1;
    let corners: Vec<String> = (9..9 + n).map(|i| i.to_string()).collect();
    obj += &format!("f {}\n", corners.join(" "));
    write(dir.path(), "round.obj", obj);
    let started = Instant::now();
    let out = clerestory(dir.path(), ["ingest", "s.clr", "round.obj", "--json"]);
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let summary: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(summary["skipped"]["too_many_corners"], 1, "{summary}");
    let expected = format!("round.obj:{line}: face has 1000000 corners, over the limit of 16384");
    assert!(said(&out).contains(&expected), "{}", said(&out));
    assert!(started.elapsed() < Duration::from_secs(60), "{:?}", started.elapsed());
}

#[test]
fn what_cannot_be_written_is_refused_before_anything_is_computed() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), "plain.mtl", materials(PLAIN));
    write(dir.path(), "plain.obj", room(b"plain.mtl", PLAIN));
    let run = clerestory(dir.path(), ["run", "plain.obj", "--quality", "preview"]);
    assert_eq!(run.status.code(), Some(0), "{}", said(&run));
    write(dir.path(), "p.csv", "x,y,z,nx,ny,nz\nnot a number,0,0,0,0,1\n");
    for args in [
        &["sample", "plain.clr", "--points", "p.csv", "-o", "no dir/x.csv"][..],
        &["render", "plain.clr", "-o", "no dir/x.png"],
        &["export", "plain.clr", "-o", "no dir/x.glb"],
    ] {
        let out = clerestory(dir.path(), args);
        assert_eq!(out.status.code(), Some(1), "{args:?}");
        let file = args.last().unwrap();
        let expected = format!("error: {file}: there is no folder no dir\nhelp: make it with `mkdir -p 'no dir'`");
        assert!(said(&out).contains(&expected), "{}", said(&out));
    }
}

#[test]
fn a_reader_of_points_that_goes_away_ends_the_sampling() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), "plain.mtl", materials(PLAIN));
    write(dir.path(), "plain.obj", room(b"plain.mtl", PLAIN));
    let run = clerestory(dir.path(), ["run", "plain.obj", "--quality", "preview"]);
    assert_eq!(run.status.code(), Some(0), "{}", said(&run));
    // Points that never end: only a sampling that stops comes to an end.
    let script = "(echo x,y,z,nx,ny,nz; yes 1.5,1.5,0,0,0,1) | \"$0\" sample plain.clr --points - -o - \
                  2>said | head -3; echo ${PIPESTATUS[1]}";
    let started = Instant::now();
    let child = Command::new("timeout")
        .args(["60", "bash", "-c", script, env!("CARGO_BIN_EXE_clerestory")])
        .current_dir(dir.path())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let out = child.wait_with_output().unwrap();
    let lines: Vec<String> = String::from_utf8(out.stdout).unwrap().lines().map(str::to_owned).collect();
    assert!(lines.len() == 4 && lines[2].starts_with("1.5,1.5,0,0,0,1,"), "{lines:?}");
    assert_eq!(lines[3], "0", "exit code");
    assert_eq!(std::fs::read_to_string(dir.path().join("said")).unwrap(), "");
    assert!(started.elapsed() < Duration::from_secs(30), "{:?}", started.elapsed());
    for verb in ["render plain.clr --size 640x480 -o -", "export plain.clr -o -"] {
        let script = format!(
            "'{}' {verb} 2>said | head -c 9 >/dev/null; echo ${{PIPESTATUS[0]}}",
            env!("CARGO_BIN_EXE_clerestory")
        );
        let out = Command::new("bash").args(["-c", &script]).current_dir(dir.path()).output().unwrap();
        let said = std::fs::read_to_string(dir.path().join("said")).unwrap();
        assert_eq!(String::from_utf8(out.stdout).unwrap().trim(), "0", "{verb}: {said}");
    }
}
