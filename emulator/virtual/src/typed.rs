//! What a person, or a test, types while a board runs: events of a script, which happen at once.

use crate::script;
use crate::session::Session;
use anyhow::Result;
use std::io::{Write, stdin, stdout};
use std::sync::mpsc::{Receiver, channel};

fn perform(board: &mut Session, text: &str) -> Result<()> {
    script::parse(&format!("at 0s {text}"))?.into_iter().try_for_each(|step| board.perform(step))
}

/// Lines of standard input.
pub struct Typed(Receiver<String>);

impl Typed {
    /// Listens from now on.
    pub fn listen() -> Self {
        let (sender, receiver) = channel();
        std::thread::spawn(move || stdin().lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        Self(receiver)
    }

    /// Lets all that was typed happen to a board, and says so for who waits for it. What is no event, or one that the
    /// board cannot do, is told, and the board goes on.
    ///
    /// # Errors
    /// It cannot be told.
    pub fn happen(&self, board: &mut Session) -> Result<()> {
        for text in self.0.try_iter() {
            match perform(board, &text) {
                Ok(()) => println!("happens: {text}"),
                Err(error) => eprintln!("{text:?}: {error:#}"),
            }
            stdout().flush()?;
        }
        Ok(())
    }
}
