//! What a person, or a test, types while a board runs: events of a script, which happen at once.

use crate::script;
use crate::session::Session;
use anyhow::{Context, Result};
use std::io::{Write, stdin, stdout};
use std::sync::mpsc::{Receiver, channel};

/// Lines of standard input.
pub struct Typed(Receiver<String>);

impl Typed {
    /// Listens from now on.
    pub fn listen() -> Self {
        let (sender, receiver) = channel();
        std::thread::spawn(move || stdin().lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        Self(receiver)
    }

    /// Lets all that was typed happen to a board, and says so for who waits for it.
    ///
    /// # Errors
    /// What is no event, or one that the board cannot do.
    pub fn happen(&self, board: &mut Session) -> Result<()> {
        for text in self.0.try_iter() {
            for step in script::parse(&format!("at 0s {text}")).context(text.clone())? {
                board.perform(step)?;
            }
            println!("happens: {text}");
            stdout().flush()?;
        }
        Ok(())
    }
}
