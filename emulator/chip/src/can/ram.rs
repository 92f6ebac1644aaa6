//! The message RAM with the layout that this chip gives it (RM0440, 44.3.5 and 44.3.6), and acceptance filters
//! (44.3.7, 44.3.8).

use super::frame::{Frame, LENGTHS};
use crate::bits::{bit, field};

/// Words of it all.
pub const WORDS: usize = 212;
/// Words of an element with data.
const ELEMENT: usize = 18;
/// Where each part begins, words.
const EXTENDED: usize = 28;
const FIFOS: [usize; 2] = [44, 98];
const EVENTS: usize = 152;
const BUFFERS: usize = 158;

/// What the filters say of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Accepted {
    /// 0 or 1; `None`: it is told as one of high priority, and not stored.
    pub fifo: Option<usize>,
    /// The filter; `None`: no filter matched.
    pub filter: Option<u32>,
    /// Of high priority.
    pub priority: bool,
}

/// RXGFC and XIDAM: what is done with frames that no filter knows, and how many filters there are.
#[derive(Clone, Copy, Debug)]
pub struct Global {
    /// RXGFC.
    pub control: u32,
    /// XIDAM.
    pub mask: u32,
}

/// The memory.
#[derive(Clone, Debug)]
pub struct Ram(pub [u32; WORDS]);

impl Ram {
    /// What becomes of a frame; `None` if nothing.
    pub fn accept(&self, frame: &Frame, global: Global) -> Option<Accepted> {
        let control = global.control;
        let (reject_remote, others, count) = if frame.extended {
            (bit(control, 0), field(control, 2, 2), field(control, 24, 4).min(8))
        } else {
            (bit(control, 1), field(control, 4, 2), field(control, 16, 5).min(28))
        };
        if frame.remote && reject_remote {
            return None;
        }
        for index in 0..count {
            let (action, matches) = if frame.extended {
                self.extended(index as usize, frame.id, global.mask)
            } else {
                self.standard(index as usize, frame.id)
            };
            let fifo = match action {
                1 | 2 => Some(action as usize - 1),
                5 | 6 => Some(action as usize - 5),
                _ => None,
            };
            match action {
                1 | 2 | 4..=6 if matches => return Some(Accepted { fifo, filter: Some(index), priority: action >= 4 }),
                3 if matches => return None,
                _ => {}
            }
        }
        match others {
            fifo @ (0 | 1) => Some(Accepted { fifo: Some(fifo as usize), filter: None, priority: false }),
            _ => None,
        }
    }

    /// Action of a filter, and whether it matches.
    fn standard(&self, index: usize, id: u32) -> (u32, bool) {
        let word = self.0[index];
        let (first, second) = (field(word, 16, 11), field(word, 0, 11));
        let matches = match field(word, 30, 2) {
            0 => (first..=second).contains(&id),
            1 => id == first || id == second,
            2 => (id ^ first) & second == 0,
            _ => false,
        };
        (field(word, 27, 3), matches)
    }

    fn extended(&self, index: usize, id: u32, mask: u32) -> (u32, bool) {
        let [low, high] = [self.0[EXTENDED + 2 * index], self.0[EXTENDED + 2 * index + 1]];
        let (first, second) = (field(low, 0, 29), field(high, 0, 29));
        let matches = match field(high, 30, 2) {
            0 => (first..=second).contains(&(id & mask)),
            1 => [first, second].contains(&(id & mask)),
            2 => (id ^ first) & second == 0,
            _ => (first..=second).contains(&id),
        };
        (field(low, 29, 3), matches)
    }

    /// A frame into an element of a FIFO.
    pub fn store(&mut self, fifo: usize, element: usize, frame: &Frame, accepted: Accepted, stamp: u32) {
        let place = FIFOS[fifo] + ELEMENT * element;
        let matched = accepted.filter.map_or(1 << 31, |filter| filter << 24);
        self.0[place] = header(frame);
        self.0[place + 1] = matched | format(frame) | stamp & 0xffff;
        let mut words = [0; 16];
        for (at, byte) in frame.data.iter().enumerate() {
            words[at / 4] |= u32::from(*byte) << (8 * (at % 4));
        }
        let used = frame.data.len().div_ceil(4);
        self.0[place + 2..][..used].copy_from_slice(&words[..used]);
    }

    /// The frame in a buffer; it is sent passive, or at one rate, where the controller may do no more.
    pub fn load(&self, buffer: usize, fd: bool, switching: bool, passive: bool) -> Frame {
        let [first, second] = [self.0[BUFFERS + ELEMENT * buffer], self.0[BUFFERS + ELEMENT * buffer + 1]];
        let extended = bit(first, 30);
        let fd = fd && bit(second, 21);
        let length = LENGTHS[field(second, 16, 4) as usize].min(if fd { 64 } else { 8 });
        let words = &self.0[BUFFERS + ELEMENT * buffer + 2..];
        let data = (0..length).map(|at| (words[at / 4] >> (8 * (at % 4))) as u8);
        let remote = bit(first, 29) && !fd;
        Frame {
            id: if extended { field(first, 0, 29) } else { field(first, 18, 11) },
            extended,
            remote,
            fd,
            switched: fd && switching && bit(second, 20),
            passive: fd && (passive || bit(first, 31)),
            data: if remote { vec![0; length] } else { data.collect() },
        }
    }

    /// Whether a buffer wants an event, and its marker.
    pub fn marker(&self, buffer: usize) -> Option<u32> {
        let second = self.0[BUFFERS + ELEMENT * buffer + 1];
        bit(second, 23).then_some(second >> 24)
    }

    /// A frame that has gone into an element of the FIFO of events.
    pub fn note(&mut self, element: usize, frame: &Frame, marker: u32, stamp: u32) {
        self.0[EVENTS + 2 * element] = header(frame);
        self.0[EVENTS + 2 * element + 1] = marker << 24 | 1 << 22 | format(frame) | stamp & 0xffff;
    }
}

fn header(frame: &Frame) -> u32 {
    let id = if frame.extended { frame.id | 1 << 30 } else { frame.id << 18 };
    id | u32::from(frame.remote) << 29 | u32::from(frame.passive) << 31
}

fn format(frame: &Frame) -> u32 {
    u32::from(frame.fd) << 21 | u32::from(frame.switched) << 20 | frame.code() << 16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn accepts(ram: &Ram, id: u32, extended: bool, control: u32) -> Option<(Option<usize>, Option<u32>)> {
        let frame = Frame { id, extended, ..Frame::default() };
        ram.accept(&frame, Global { control, mask: 0x1fff_ffff }).map(|to| (to.fifo, to.filter))
    }

    #[test]
    fn parts_do_not_overlap() {
        assert_eq!((EXTENDED + 16, FIFOS[0] + 3 * ELEMENT, FIFOS[1] + 3 * ELEMENT), (FIFOS[0], FIFOS[1], EVENTS));
        assert_eq!((EVENTS + 6, BUFFERS + 3 * ELEMENT), (BUFFERS, WORDS));
        // Offsets of table 403.
        assert_eq!([EXTENDED, FIFOS[0], FIFOS[1], EVENTS, BUFFERS].map(|at| 4 * at), [0x70, 0xb0, 0x188, 0x260, 0x278]);
    }

    #[test]
    fn standard_filters_in_their_order() {
        let mut ram = Ram([0; WORDS]);
        ram.0[0] = 2 << 30 | 1 << 27 | 0x001 << 16 | 0x07f;
        ram.0[1] = 1 << 30 | 2 << 27 | 0x123 << 16 | 0x456;
        ram.0[2] = 3 << 27 | 0x600 << 16 | 0x6ff;
        ram.0[3] = 6 << 27 | 0x700 << 16 | 0x7ff;
        // Four filters, all else rejected.
        let control = 4 << 16 | 2 << 4;
        assert_eq!(accepts(&ram, 0x701, false, control), Some((Some(0), Some(0))), "the first that matches");
        assert_eq!(accepts(&ram, 0x456, false, control), Some((Some(1), Some(1))));
        assert_eq!(accepts(&ram, 0x610, false, control), None);
        assert_eq!(accepts(&ram, 0x702, false, control), Some((Some(1), Some(3))));
        assert_eq!(accepts(&ram, 0x002, false, control), None);
        assert_eq!(accepts(&ram, 0x002, false, 4 << 16 | 1 << 4), Some((Some(1), None)), "the rest to FIFO 1");
        assert_eq!(accepts(&ram, 0x456, false, 1 << 16 | 2 << 4), None, "only one filter is in use");
    }

    #[test]
    fn extended_filters_and_remote_frames() {
        let mut ram = Ram([0; WORDS]);
        ram.0[EXTENDED] = 1 << 29 | 0x0001;
        ram.0[EXTENDED + 1] = 2 << 30 | 0x1fff_00ff;
        let control = 1 << 24 | 2 << 2;
        assert_eq!(accepts(&ram, 0x8001, true, control), Some((Some(0), Some(0))));
        assert_eq!(accepts(&ram, 0x1_8001, true, control), None, "another prefix");
        assert_eq!(accepts(&ram, 0x8002, true, control), None);
        let remote = Frame { id: 0x8001, extended: true, remote: true, ..Frame::default() };
        assert_eq!(ram.accept(&remote, Global { control: control | 1, mask: 0x1fff_ffff }), None);
    }

    #[test]
    fn a_frame_is_stored_and_loaded_as_it_is() {
        let mut ram = Ram([0; WORDS]);
        let frame = Frame::switched(0x1234_8001, true, &(0..48).collect::<Vec<u8>>());
        ram.store(1, 2, &frame, Accepted { fifo: Some(1), filter: None, priority: false }, 7);
        let element: Vec<u32> = ram.0[FIFOS[1] + 36..][..18].to_vec();
        assert_eq!(element[1], 1 << 31 | 1 << 21 | 1 << 20 | 14 << 16 | 7);
        ram.0[BUFFERS..][..18].copy_from_slice(&element);
        assert_eq!(ram.load(0, true, true, false), frame);
        assert!(!ram.load(0, true, false, false).switched);
        assert_eq!(ram.load(0, false, false, false).data.len(), 8, "a classic frame");
    }
}
