//! The documentation is what the code says: the list of faults, the example frame, the links.

use hallservo::fault::Fault;
use hallservo_protocol::{Answer, Ask, Decoder, FRAME, MESSAGE, Reply, Request, VERSION, encode};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(file: &str) -> String {
    fs::read_to_string(root().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// The page of all faults, from the code's texts.
fn faults() -> String {
    let mut page = String::from(
        "# Faults\n\nWhat switches the bridge off, until a person has cleared it. `hallctl faults` says which, \
         when, and what to do.\nThis page is made from the code's own texts: `UPDATE_DOCS=1 cargo test -p hallctl --test all docs::`.\n\n\
         | number | what the drive says | what to do |\n|---:|---|---|\n",
    );
    for fault in Fault::all() {
        let advice = hallctl::words::what_to_do(fault);
        let _ = writeln!(page, "| {} | {fault} | {advice} |", fault.code());
    }
    page
}

#[test]
fn the_list_of_faults_is_the_codes() {
    if env::var_os("UPDATE_DOCS").is_some() {
        fs::write(root().join("docs/faults.md"), faults()).unwrap();
    }
    assert_eq!(read("docs/faults.md"), faults(), "run UPDATE_DOCS=1 cargo test -p hallctl --test all docs::");
    assert!(Fault::all().count() > 40);
}

/// Bytes as in the page: pairs of digits.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ")
}

#[test]
fn the_frames_of_the_page_are_those_of_the_code() {
    let page = read("docs/protocol.md");
    assert!(page.contains(&format!("The version is one byte, now {VERSION}.")), "{VERSION}");
    let limits = format!("A message has at most {MESSAGE} bytes, a frame at most {FRAME}.");
    assert!(page.contains(&limits), "{limits}");
    let mut frame = [0; FRAME];
    let request = Request { id: 1, client: 300, unattended: false, ask: Ask::Speed(-1.5) };
    let length = encode(&request, &mut frame).unwrap();
    assert!(page.contains(&hex(&frame[..length])), "{}", hex(&frame[..length]));
    let mut decoder = Decoder::default();
    let mut found = frame[..length].iter().filter_map(|&byte| decoder.push::<Request>(byte).map(|r| r.is_ok()));
    assert_eq!((found.next(), found.next()), (Some(true), None));
    let length = encode(&Reply { id: 1, answer: Answer::Done }, &mut frame).unwrap();
    assert!(page.contains(&hex(&frame[..length])), "{}", hex(&frame[..length]));
}

/// A heading as its anchor.
fn anchor(heading: &str) -> String {
    let kept = heading.to_lowercase();
    kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c)).map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn links(page: &str) -> Vec<String> {
    page.split("](").skip(1).filter_map(|rest| rest.split(')').next()).map(String::from).collect()
}

#[test]
fn every_link_leads_somewhere() {
    let mut pages = vec!["README.md", "SAFETY.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"];
    let docs: Vec<_> = fs::read_dir(root().join("docs"))
        .unwrap()
        .map(|entry| format!("docs/{}", entry.unwrap().file_name().into_string().unwrap()))
        // These two are chapters of the library's documentation.
        .filter(|name| name.ends_with(".md") && !name.contains("porting") && !name.contains("glossary"))
        .collect();
    pages.extend(docs.iter().map(String::as_str));
    let mut broken = Vec::new();
    for page in pages {
        let text = read(page);
        for link in links(&text).iter().filter(|link| !link.starts_with("http")) {
            let (file, place) = link.split_once('#').unwrap_or((link, ""));
            let target =
                if file.is_empty() { root().join(page) } else { root().join(page).with_file_name("").join(file) };
            let there = target.exists()
                && (place.is_empty()
                    || fs::read_to_string(&target)
                        .unwrap()
                        .lines()
                        .any(|line| line.starts_with('#') && anchor(line.trim_start_matches(['#', ' '])) == place));
            if !there {
                broken.push(format!("{page}: {link}"));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

/// A page that nobody finds might as well not be there.
#[test]
fn the_readme_leads_to_every_page() {
    let readme = read("README.md");
    for page in ["features", "numbers", "hardware", "protocol", "faults", "building", "tool", "porting", "glossary"] {
        assert!(readme.contains(&format!("docs/{page}.md")), "{page}");
    }
}
