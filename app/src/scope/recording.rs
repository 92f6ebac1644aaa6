//! Recordings on request: whose the scope is, and what is answered of it.

use hallservo::scope::{BORROWS, CHANNELS, Channel, Channels, Plan, ROWS, Recorder, Recording, Scope, Setup, State};
use hallservo::service::Service;
use hallservo_protocol::{Answer, ROWS_AT_ONCE, Refusal, ScopeAsk, ScopeRefusal, ScopeRows, ScopeStatus};

/// Time after which a tool that asks nothing of the scope has left it, ms.
const LEFT_MS: u64 = 2000;

/// What is static of the scope.
pub(crate) struct ScopeMemory {
    channels: Channels,
    /// None where it is borrowed.
    recording: [Recording; if BORROWS { 0 } else { 1 }],
}

impl ScopeMemory {
    pub const fn new() -> Self {
        Self { channels: Channels::new(), recording: [const { Recording::new() }; if BORROWS { 0 } else { 1 }] }
    }
}

/// Whose recording it is.
struct Owner {
    client: u32,
    id: u32,
    setup: Setup,
    scales: [f32; CHANNELS],
    /// Raw position where the user's was zero.
    origin: i32,
    asked_ms: u64,
}

/// The tasks' side.
pub(crate) struct ScopeTasks {
    scope: Scope,
    recorder: Option<Recorder>,
    owner: Option<Owner>,
    /// A recording that begins as soon as the one before has ended.
    due: Option<Plan>,
}

/// What a request is about, beside what it asks.
pub(crate) struct From<'a> {
    pub client: u32,
    pub now_ms: u64,
    pub service: &'a mut Service,
    pub step_hz: f32,
    pub origin: i32,
}

impl ScopeTasks {
    pub fn start(memory: &'static mut ScopeMemory) -> Self {
        let ScopeMemory { channels, recording } = memory;
        let (recorder, scope) = channels.split(recording.first_mut());
        Self { scope, recorder: Some(recorder), owner: None, due: None }
    }

    /// For the control interrupt, once.
    pub const fn recorder(&mut self) -> Option<Recorder> {
        self.recorder.take()
    }

    /// A calibration needs the memory back, where it is borrowed: what was recorded is lost.
    pub fn give_back(&mut self, service: &mut Service) {
        if BORROWS {
            self.scope.cancel();
            (self.owner, self.due) = (None, None);
            if let Some(memory) = self.scope.take_memory() {
                service.take_back(memory);
            }
        }
    }

    /// A command is sent to the drive.
    pub fn commanded(&self) {
        self.scope.commanded();
    }

    /// An answer that is there already, [`Answer::Done`], stays where there is no other one.
    // A frame of its own, which is not to add to the stack of other requests; an answer is written right to its place.
    #[inline(never)]
    pub fn ask(&mut self, ask: &ScopeAsk, mut from: From<'_>, answer: &mut Answer<'static>) {
        if let Some(owner) = self.owner.as_mut().filter(|owner| owner.client == from.client) {
            owner.asked_ms = from.now_ms;
        }
        self.begin_due(from.service);
        let done = match ask {
            _ if self.recorder.is_some() => Err(ScopeRefusal::None),
            ScopeAsk::Status => {
                *answer = Answer::Scope(self.status());
                Ok(())
            }
            ScopeAsk::Begin { id, setup } => self.begin(*id, setup, &mut from),
            ScopeAsk::Rows { id, first } => self.rows(*id, *first, answer),
            ScopeAsk::End => self.end(&from),
        };
        if let Err(refusal) = done {
            *answer = Answer::Refused(Refusal::Scope(refusal));
        }
    }

    fn end(&mut self, from: &From<'_>) -> Result<(), ScopeRefusal> {
        if !self.yields(from) {
            return Err(ScopeRefusal::Busy);
        }
        self.scope.cancel();
        (self.owner, self.due) = (None, None);
        Ok(())
    }

    fn begin_due(&mut self, service: &mut Service) {
        if BORROWS
            && self.due.is_some()
            && let Some(memory) = service.lend()
        {
            self.scope.give(memory);
        }
        if let Some(plan) = &self.due
            && self.scope.begin(plan).is_ok()
        {
            self.due = None;
        }
    }

    fn state(&mut self) -> State {
        if self.due.is_some() { State::Waiting } else { self.scope.state() }
    }

    /// Whether the scope may be another tool's now.
    #[inline(never)]
    fn yields(&self, from: &From<'_>) -> bool {
        let left = |owner: &Owner| from.now_ms >= owner.asked_ms + LEFT_MS;
        self.owner.as_ref().is_none_or(|owner| owner.client == from.client || left(owner))
    }

    fn begin(&mut self, id: u32, setup: &Setup, from: &mut From<'_>) -> Result<(), ScopeRefusal> {
        if !self.yields(from) {
            return Err(ScopeRefusal::Busy);
        }
        // Asked again, as the answer was lost.
        if self.owner.as_ref().is_some_and(|owner| owner.id == id && owner.client == from.client) {
            return Ok(());
        }
        let config = from.service.config();
        let plan = setup.plan(config, from.step_hz, from.origin).map_err(ScopeRefusal::Setup)?;
        // The one before ends with the next period.
        self.scope.cancel();
        self.due = Some(plan);
        let scale = |channel: Option<Channel>| channel.and_then(|channel| channel.scale(config, from.step_hz));
        let scales = setup.channels.map(|channel| scale(channel).unwrap_or(0.0));
        let From { client, now_ms, origin, .. } = *from;
        self.begin_due(from.service);
        self.owner = Some(Owner { client, id, setup: *setup, scales, origin, asked_ms: now_ms });
        Ok(())
    }

    fn status(&mut self) -> ScopeStatus {
        let (capacity, state) = (ROWS as u16, self.state());
        match &self.owner {
            None => ScopeStatus { capacity, ..ScopeStatus::default() },
            Some(Owner { client, id, setup, scales, .. }) => {
                ScopeStatus { id: *id, client: *client, state, capacity, setup: Some(*setup), scales: *scales }
            }
        }
    }

    /// The rows of a complete recording.
    fn rows(&mut self, id: u32, first: u16, answer: &mut Answer<'static>) -> Result<(), ScopeRefusal> {
        let done = self.state() == State::Done;
        let owner = self.owner.as_ref().filter(|owner| done && owner.id == id).ok_or(ScopeRefusal::Gone)?;
        let mut rows = [[0; CHANNELS]; ROWS_AT_ONCE];
        for (offset, row) in (0..).zip(&mut rows) {
            let Some(raw) = self.scope.raw(first.saturating_add(offset)) else { break };
            for ((value, raw), channel) in row.iter_mut().zip(raw).zip(&owner.setup.channels) {
                let origin = if channel.is_some_and(Channel::is_position) { owner.origin } else { 0 };
                *value = raw.cast_signed().wrapping_sub(origin);
            }
        }
        *answer = Answer::ScopeRows(ScopeRows { id, first, rows });
        Ok(())
    }
}
