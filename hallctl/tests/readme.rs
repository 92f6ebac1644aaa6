//! The conversation with a drive in `docs/tool.md`, command by command as it stands there, at a drive that is simulated
//! anew: each does and says what is written, whatever the figures.

use crate::process::{Drive, HALLCTL, PATIENCE};
use std::process::{Command, Stdio};

/// Figures are masked, their signs, and the room that they take.
fn masked(text: &str) -> String {
    let mut out = String::new();
    for part in text.split_whitespace() {
        let figure = part.trim_start_matches(['+', '-']);
        let mut last = ' ';
        for character in if figure.starts_with(|c: char| c.is_ascii_digit()) { figure } else { part }.chars() {
            let character = if character.is_ascii_digit() || character == '.' { '#' } else { character };
            if character != '#' || last != '#' {
                out.push(character);
            }
            last = character;
        }
        out.push(' ');
    }
    out
}

/// The commands of the block, and what is printed under each.
fn conversation(page: &str) -> Vec<(Vec<String>, String)> {
    let block = page.split("```console\n").nth(1).unwrap().split("```").next().unwrap();
    let mut said: Vec<(Vec<String>, String)> = Vec::new();
    for line in block.lines() {
        match line.strip_prefix("$ ") {
            Some(command) => {
                let command = command.split(" #").next().unwrap();
                said.push((command.split_whitespace().map(String::from).collect(), String::new()));
            }
            None => said.last_mut().unwrap().1 += &format!("{line}\n"),
        }
    }
    said
}

#[test]
fn every_command_of_the_page_does_what_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (mut drive, mut commands) = (None, 0);
    for (command, printed) in conversation(include_str!("../../docs/tool.md")) {
        let words: Vec<_> = command.iter().map(String::as_str).collect();
        match words[..] {
            ["cargo", ..] | ["export", ..] => {}
            ["hallctl", "simulate", ref options @ ..] => {
                let flash = folder.path().join("drive.bin");
                let options: Vec<_> = options
                    .iter()
                    .map(|&word| if word == "drive.bin" { flash.to_str().unwrap() } else { word })
                    .collect();
                drive = Some(Drive::start(&options));
            }
            ["hallctl", ref arguments @ ..] => {
                let output = Command::new(HALLCTL)
                    .args(arguments)
                    .envs([("HALLCTL_PORT", drive.as_ref().unwrap().port.as_str()), PATIENCE])
                    .current_dir(folder.path())
                    .stdin(Stdio::null())
                    .output()
                    .unwrap();
                let found = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
                assert_eq!(masked(&found), masked(&printed), "{command:?}: {found}");
                assert_eq!(output.status.success(), !printed.starts_with("hallctl: "), "{command:?}");
                commands += 1;
            }
            _ => panic!("{command:?}"),
        }
    }
    assert_eq!(commands, 6);
    assert!(folder.path().join("t.csv").exists() && folder.path().join("t.html").exists());
}
