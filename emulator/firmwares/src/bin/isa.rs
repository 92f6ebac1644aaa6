//! Random instructions of every class with random operands; a digest of what they leave in registers, flags and memory.
//! The core that this runs on agrees with another one where it prints the same.
#![no_std]
#![no_main]

use core::arch::global_asm;
use cortex_m_rt::entry;
use firmwares::{exit, say};

#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [usize; 1] = [0];

/// What an instruction works on, as the trampoline loads and stores it.
#[repr(C)]
#[derive(Clone, Copy)]
struct State {
    r: [u32; 13],
    flags: u32,
    s: [u32; 32],
    fpscr: u32,
}

/// The instruction under test, and the way back.
#[repr(C, align(4))]
struct Code([u16; 16]);

static mut CODE: Code = Code([0; 16]);

/// What memory instructions work on.
#[repr(C, align(16))]
struct Scratch([u32; 64]);

static mut SCRATCH: Scratch = Scratch([0; 64]);

global_asm!(
    ".global run_one",
    ".thumb_func",
    "run_one:",
    "push {{r4-r11, lr}}",
    "vpush {{s16-s31}}",
    "push {{r0, r1}}",
    "mov lr, r1",
    "ldr r2, [r0, #184]",
    "vmsr fpscr, r2",
    "add r2, r0, #56",
    "vldmia r2, {{s0-s31}}",
    "ldr r2, [r0, #52]",
    "msr apsr_nzcvqg, r2",
    "ldmia r0, {{r0-r12}}",
    "blx lr",
    "push {{r0-r12}}",
    "ldr r0, [sp, #52]",
    "mrs r1, apsr",
    "str r1, [r0, #52]",
    "add r2, r0, #56",
    "vstmia r2, {{s0-s31}}",
    "vmrs r1, fpscr",
    "str r1, [r0, #184]",
    "mov r12, r0",
    "pop {{r0-r7}}",
    "stmia r12!, {{r0-r7}}",
    "pop {{r0-r4}}",
    "stmia r12!, {{r0-r4}}",
    "pop {{r0, r1}}",
    "vpop {{s16-s31}}",
    "pop {{r4-r11, pc}}",
);

unsafe extern "C" {
    fn run_one(state: *mut State, code: usize);
}

struct Random(u32);

impl Random {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }

    fn integer(&mut self) -> u32 {
        const SPECIAL: [u32; 8] = [0, 1, 0x7FFF_FFFF, 0x8000_0000, u32::MAX, 0x8000, 0x7FFF, 0xFF];
        let random = self.next();
        match self.next() % 4 {
            0 => SPECIAL[random as usize % 8],
            1 => random >> (random & 31),
            _ => random,
        }
    }

    fn float(&mut self) -> u32 {
        const SPECIAL: [u32; 10] = [
            0,
            0x8000_0000,
            0x7F80_0000,
            0xFF80_0000,
            0x7FC0_1234,
            0x7F80_4321,
            0x0000_0001,
            0x3F80_0000,
            0x4F00_0000,
            0xFFA0_0001,
        ];
        let random = self.next();
        match self.next() % 4 {
            0 => SPECIAL[random as usize % 10],
            1 => (random as i32 as f32 / 65536.0).to_bits(),
            // Of like size, so that sums cancel and products stay finite.
            2 => random & 0x83FF_FFFF | 0x3C00_0000,
            _ => random,
        }
    }
}

/// Bits that every instruction of a class has, bits that vary, and whether it makes sense at all.
struct Class {
    name: &'static str,
    fixed: u32,
    vary: u32,
    kind: Kind,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Narrow,
    Wide,
    /// R1 points to memory, R2 is a small index.
    NarrowMemory,
    WideMemory,
    /// Two fields, `lsb` and `lsb + width` or `msb`, must fit.
    Extract,
    Insert,
    /// An IT instruction and four more.
    It,
    /// A conditional branch over one instruction.
    Branch,
}

const fn narrow(name: &'static str, fixed: u32, vary: u32) -> Class {
    Class { name, fixed, vary, kind: Kind::Narrow }
}

const fn wide(name: &'static str, fixed: u32, vary: u32) -> Class {
    Class { name, fixed, vary, kind: Kind::Wide }
}

const fn memory(name: &'static str, fixed: u32, vary: u32) -> Class {
    let kind = if fixed >> 16 == 0 { Kind::NarrowMemory } else { Kind::WideMemory };
    Class { name, fixed, vary, kind }
}

/// Rn, Rd and Rm of wide instructions, R0 to R7.
const N: u32 = 0x0007_0000;
const D: u32 = 0x0000_0700;
const M: u32 = 0x0000_0007;
/// Ra, or RdLo.
const A: u32 = 0x0000_7000;
/// imm3:imm2 and type of a shifted register.
const SHIFT: u32 = 0x0000_70F0;
/// i:imm3:imm8.
const IMM: u32 = 0x0400_70FF;
const S: u32 = 0x0010_0000;
/// Single registers of FP instructions.
const SD: u32 = 0x0040_F000;
const SN: u32 = 0x000F_0080;
const SM: u32 = 0x0000_002F;

const CLASSES: &[Class] = &[
    narrow("shift, add, move, compare", 0x0000, 0x3FFF),
    narrow("data processing", 0x4000, 0x03FF),
    narrow("add high", 0x4480, 0x003B),
    narrow("compare high", 0x4580, 0x003B),
    narrow("move high", 0x4640, 0x001F),
    narrow("extend", 0xB200, 0x00FF),
    narrow("rev", 0xBA00, 0x007F),
    narrow("revsh", 0xBAC0, 0x003F),
    wide("and reg", 0xEA00_0000, N | D | M | SHIFT | S),
    wide("bic reg", 0xEA20_0000, N | D | M | SHIFT | S),
    wide("orr reg", 0xEA40_0000, N | D | M | SHIFT | S),
    wide("mov reg", 0xEA4F_0000, D | M | SHIFT | S),
    wide("orn reg", 0xEA60_0000, N | D | M | SHIFT | S),
    wide("mvn reg", 0xEA6F_0000, D | M | SHIFT | S),
    wide("eor reg", 0xEA80_0000, N | D | M | SHIFT | S),
    wide("tst reg", 0xEA10_0F00, N | M | SHIFT),
    wide("teq reg", 0xEA90_0F00, N | M | SHIFT),
    wide("cmn reg", 0xEB10_0F00, N | M | SHIFT),
    wide("cmp reg", 0xEBB0_0F00, N | M | SHIFT),
    wide("pkh", 0xEAC0_0000, N | D | M | (SHIFT & !0x10)),
    wide("add reg", 0xEB00_0000, N | D | M | SHIFT | S),
    wide("adc reg", 0xEB40_0000, N | D | M | SHIFT | S),
    wide("sbc reg", 0xEB60_0000, N | D | M | SHIFT | S),
    wide("sub reg", 0xEBA0_0000, N | D | M | SHIFT | S),
    wide("rsb reg", 0xEBC0_0000, N | D | M | SHIFT | S),
    wide("and imm", 0xF000_0000, N | D | IMM | S),
    wide("bic imm", 0xF020_0000, N | D | IMM | S),
    wide("orr imm", 0xF040_0000, N | D | IMM | S),
    wide("mov imm", 0xF04F_0000, D | IMM | S),
    wide("orn imm", 0xF060_0000, N | D | IMM | S),
    wide("mvn imm", 0xF06F_0000, D | IMM | S),
    wide("eor imm", 0xF080_0000, N | D | IMM | S),
    wide("tst imm", 0xF010_0F00, N | IMM),
    wide("teq imm", 0xF090_0F00, N | IMM),
    wide("cmn imm", 0xF110_0F00, N | IMM),
    wide("cmp imm", 0xF1B0_0F00, N | IMM),
    wide("add imm", 0xF100_0000, N | D | IMM | S),
    wide("adc imm", 0xF140_0000, N | D | IMM | S),
    wide("sbc imm", 0xF160_0000, N | D | IMM | S),
    wide("sub imm", 0xF1A0_0000, N | D | IMM | S),
    wide("rsb imm", 0xF1C0_0000, N | D | IMM | S),
    wide("addw", 0xF200_0000, N | D | IMM),
    wide("subw", 0xF2A0_0000, N | D | IMM),
    wide("movw", 0xF240_0000, 0x000F_0000 | D | IMM),
    wide("movt", 0xF2C0_0000, 0x000F_0000 | D | IMM),
    wide("ssat", 0xF300_0040, N | D | 0x0020_709F),
    wide("usat", 0xF380_0040, N | D | 0x0020_709F),
    wide("ssat16", 0xF320_0000, N | D | 0xF),
    wide("usat16", 0xF3A0_0000, N | D | 0xF),
    Class { name: "sbfx", fixed: 0xF340_0000, vary: N | D | 0x70DF, kind: Kind::Extract },
    Class { name: "ubfx", fixed: 0xF3C0_0000, vary: N | D | 0x70DF, kind: Kind::Extract },
    Class { name: "bfi", fixed: 0xF360_0000, vary: N | D | 0x70DF, kind: Kind::Insert },
    Class { name: "bfc", fixed: 0xF36F_0000, vary: D | 0x70DF, kind: Kind::Insert },
    wide("shift by register", 0xFA00_F000, N | D | M | S | 0x0060_0000),
    wide("extend and add", 0xFA00_F080, N | D | M | 0x0030_0030),
    wide("extend byte and add", 0xFA40_F080, N | D | M | 0x0010_0030),
    wide("extend wide", 0xFA0F_F080, D | M | 0x0010_0030),
    wide("extend byte wide", 0xFA4F_F080, D | M | 0x0010_0030),
    wide("add8", 0xFA80_F000, N | D | M | 0x0040),
    wide("qadd8, shadd8", 0xFA80_F010, N | D | M | 0x0040),
    wide("halving add8", 0xFA80_F020, N | D | M | 0x0040),
    wide("add16, asx", 0xFA90_F000, N | D | M | 0x0040),
    wide("saturating add16", 0xFA90_F010, N | D | M | 0x0040),
    wide("halving add16", 0xFA90_F020, N | D | M | 0x0040),
    wide("asx", 0xFAA0_F000, N | D | M | 0x0040),
    wide("saturating asx", 0xFAA0_F010, N | D | M | 0x0040),
    wide("halving asx", 0xFAA0_F020, N | D | M | 0x0040),
    wide("sub8", 0xFAC0_F000, N | D | M | 0x0040),
    wide("saturating sub8, sub16", 0xFAC0_F010, N | D | M | 0x0010_0040),
    wide("halving sub8, sub16", 0xFAC0_F020, N | D | M | 0x0010_0040),
    wide("sub16", 0xFAD0_F000, N | D | M | 0x0040),
    wide("sax", 0xFAE0_F000, N | D | M | 0x0040),
    wide("saturating sax", 0xFAE0_F010, N | D | M | 0x0040),
    wide("halving sax", 0xFAE0_F020, N | D | M | 0x0040),
    wide("qadd and kin", 0xFA80_F080, N | D | M | 0x0030),
    wide("rev r0", 0xFA90_F080, D | 0x0030),
    wide("rev r5", 0xFA95_F085, D | 0x0030),
    wide("clz r3", 0xFAB3_F083, D),
    wide("sel", 0xFAA0_F080, N | D | M),
    wide("mla", 0xFB00_0000, N | D | M | A),
    wide("mul", 0xFB00_F000, N | D | M),
    wide("mls", 0xFB00_0010, N | D | M | A),
    wide("smlaxy", 0xFB10_0000, N | D | M | A | 0x30),
    wide("smulxy", 0xFB10_F000, N | D | M | 0x30),
    wide("smlad", 0xFB20_0000, N | D | M | A | 0x10),
    wide("smuad", 0xFB20_F000, N | D | M | 0x10),
    wide("smlaw", 0xFB30_0000, N | D | M | A | 0x10),
    wide("smulw", 0xFB30_F000, N | D | M | 0x10),
    wide("smlsd", 0xFB40_0000, N | D | M | A | 0x10),
    wide("smusd", 0xFB40_F000, N | D | M | 0x10),
    wide("smmla", 0xFB50_0000, N | D | M | A | 0x10),
    wide("smmul", 0xFB50_F000, N | D | M | 0x10),
    wide("smmls", 0xFB60_0000, N | D | M | A | 0x10),
    wide("usada8", 0xFB70_0000, N | D | M | A),
    wide("usad8", 0xFB70_F000, N | D | M),
    wide("smull", 0xFB80_3400, N | M),
    wide("umull", 0xFBA0_3400, N | M),
    wide("smlal", 0xFBC0_3400, N | M),
    wide("umlal", 0xFBE0_3400, N | M),
    wide("umaal", 0xFBE0_3460, N | M),
    wide("smlalxy", 0xFBC0_3480, N | M | 0x30),
    wide("smlald", 0xFBC0_34C0, N | M | 0x10),
    wide("smlsld", 0xFBD0_34C0, N | M | 0x10),
    wide("sdiv", 0xFB90_F0F0, N | D | M),
    wide("udiv", 0xFBB0_F0F0, N | D | M),
    wide("mrs apsr", 0xF3EF_8000, D),
    wide("msr apsr_nzcvqg", 0xF380_8C00, N),
    wide("msr apsr_nzcvq", 0xF380_8800, N),
    memory("ldr, str imm", 0x6008, 0x19C7),
    memory("ldrh, strh imm", 0x8008, 0x0FC7),
    memory("ldr, str reg", 0x5088, 0x0E07),
    memory("ldrb wide", 0xF891_0000, 0x703F),
    memory("ldrh wide", 0xF8B1_0000, 0x703F),
    memory("ldr wide", 0xF8D1_0000, 0x703F),
    memory("ldrsb wide", 0xF991_0000, 0x703F),
    memory("ldrsh wide", 0xF9B1_0000, 0x703F),
    memory("strb wide", 0xF881_0000, 0x703F),
    memory("strh wide", 0xF8A1_0000, 0x703F),
    memory("str wide", 0xF8C1_0000, 0x703F),
    memory("ldr pre and post", 0xF851_4900, 0x063F),
    memory("ldrsh pre and post", 0xF931_4900, 0x063F),
    memory("strb pre and post", 0xF801_4900, 0x063F),
    memory("str negative", 0xF841_4C00, 0x003F),
    memory("ldr reg wide", 0xF851_4002, 0x0030),
    memory("ldrsb reg wide", 0xF911_4002, 0x0030),
    memory("strh reg wide", 0xF821_4002, 0x0030),
    memory("ldrd", 0xE951_4500, 0x00A0_0007),
    memory("strd", 0xE941_4500, 0x00A0_0007),
    memory("ldm", 0xE891_0055, 0x0020_00AC),
    memory("ldmdb", 0xE911_0055, 0x0020_00AC),
    memory("stm", 0xE881_0055, 0x0020_00AC),
    memory("stmdb", 0xE901_0055, 0x0020_00AC),
    memory("ldm narrow", 0xC9F0, 0x000D),
    memory("stm narrow", 0xC1F0, 0x000D),
    memory("ldrex", 0xE851_4F00, 0x0007),
    memory("vldr", 0xED11_0A00, 0x00C0_F007),
    memory("vldr d", 0xED11_0B00, 0x0080_F007),
    memory("vstr", 0xED01_0A00, 0x00C0_F007),
    memory("vstr d", 0xED01_0B00, 0x0080_F007),
    memory("vldm", 0xEC91_3A05, 0x0020_4002),
    memory("vldmdb", 0xED31_3A05, 0x0000_4002),
    memory("vstm", 0xEC81_3A05, 0x0020_4002),
    memory("vstmdb", 0xED21_3A05, 0x0000_4002),
    wide("vmla, vmls", 0xEE00_0A00, SD | SN | SM | 0x40),
    wide("vnmla, vnmls", 0xEE10_0A00, SD | SN | SM | 0x40),
    wide("vmul, vnmul", 0xEE20_0A00, SD | SN | SM | 0x40),
    wide("vadd, vsub", 0xEE30_0A00, SD | SN | SM | 0x40),
    wide("vdiv", 0xEE80_0A00, SD | SN | SM),
    wide("vfnma, vfnms", 0xEE90_0A00, SD | SN | SM | 0x40),
    wide("vfma, vfms", 0xEEA0_0A00, SD | SN | SM | 0x40),
    wide("vmov imm", 0xEEB0_0A00, SD | 0x000F_000F),
    wide("vmov", 0xEEB0_0A40, SD | SM),
    wide("vabs", 0xEEB0_0AC0, SD | SM),
    wide("vneg", 0xEEB1_0A40, SD | SM),
    wide("vsqrt", 0xEEB1_0AC0, SD | SM),
    wide("vcvtb, vcvtt from half", 0xEEB2_0A40, SD | SM | 0x80),
    wide("vcvtb, vcvtt to half", 0xEEB3_0A40, SD | SM | 0x80),
    wide("vcmp", 0xEEB4_0A40, SD | SM | 0x80),
    wide("vcmp 0", 0xEEB5_0A40, SD | 0x80),
    wide("vcvt from integer", 0xEEB8_0A40, SD | SM | 0x80),
    wide("vcvt to integer", 0xEEBC_0A40, SD | SM | 0x0001_0080),
    wide("vcvt from 16 bit", 0xEEBA_0A40, SD | 0x0001_0007),
    wide("vcvt from 32 bit", 0xEEBA_0AC0, SD | 0x0001_002F),
    wide("vcvt to 16 bit", 0xEEBE_0A40, SD | 0x0001_0007),
    wide("vcvt to 32 bit", 0xEEBE_0AC0, SD | 0x0001_002F),
    wide("vmov to core", 0xEE10_0A10, SN | A),
    wide("vmov from core", 0xEE00_0A10, SN | A),
    wide("vmov pair to core", 0xEC54_3A10, 0x2E),
    wide("vmov pair from core", 0xEC44_3A10, 0x2E),
    wide("vmov double to core", 0xEC54_3B10, 0xF),
    wide("vmov double from core", 0xEC44_3B10, 0xF),
    wide("vmov half of double", 0xEE00_0B10, A | 0x002F_0000),
    Class { name: "it", fixed: 0xBF00, vary: 0x00FF, kind: Kind::It },
    Class { name: "branch", fixed: 0xD000, vary: 0x0F00, kind: Kind::Branch },
];

const RETURN: u16 = 0x4770;

/// The instructions of one try, or `None` where the architecture leaves open what they do.
fn assemble(class: &Class, instruction: u32, random: &mut Random) -> Option<[u16; 8]> {
    let mut code = [RETURN; 8];
    match class.kind {
        Kind::Narrow | Kind::NarrowMemory => code[0] = instruction as u16,
        Kind::It => {
            let (cond, mask) = (instruction >> 4 & 15, instruction & 15);
            if cond >= 14 || mask == 0 {
                return None;
            }
            code[0] = instruction as u16;
            for place in &mut code[1..5] {
                *place = random.next() as u16 & 0x3FFF;
            }
        }
        Kind::Branch => {
            if instruction >> 8 & 15 >= 14 {
                return None;
            }
            code[..3].copy_from_slice(&[instruction as u16, 0x304D, 0x3101]);
        }
        _ => {
            let lsb = (instruction >> 12 & 7) << 2 | instruction >> 6 & 3;
            let field = instruction & 31;
            if class.kind == Kind::Extract && lsb + field > 31 || class.kind == Kind::Insert && field < lsb {
                return None;
            }
            code[..2].copy_from_slice(&[(instruction >> 16) as u16, instruction as u16]);
        }
    }
    Some(code)
}

fn digest(digest: u32, word: u32) -> u32 {
    (digest ^ word).wrapping_mul(0x0100_0193).rotate_left(5)
}

#[entry]
fn main() -> ! {
    let mut random = Random(0x1234_5678);
    for class in CLASSES {
        let mut sum = 0x811C_9DC5;
        for _ in 0..TRIES {
            let instruction = class.fixed | random.next() & class.vary;
            let mut state = State { r: [0; 13], flags: random.next() & 0xF80F_0000, s: [0; 32], fpscr: 0 };
            state.r.fill_with(|| random.integer());
            state.s.fill_with(|| random.float());
            let scratch = &raw mut SCRATCH;
            // SAFETY: nothing else uses it.
            let words = unsafe { &mut (*scratch).0 };
            words.fill_with(|| random.next());
            if matches!(class.kind, Kind::NarrowMemory | Kind::WideMemory) {
                state.r[1] = scratch as u32 + 128;
                state.r[2] = random.next() & 15;
            }
            let Some(code) = assemble(class, instruction, &mut random) else { continue };
            let place = &raw mut CODE;
            // SAFETY: as above; the instructions end with a return.
            unsafe {
                (&mut (*place).0)[..8].copy_from_slice(&code);
                core::arch::asm!("dsb", "isb");
                run_one(&mut state, place as usize | 1);
            }
            let all = state.r.iter().chain(&state.s).chain(words.iter());
            sum = all.fold(sum, |sum, &word| digest(sum, word));
            sum = digest(digest(sum, state.flags), state.fpscr & 0xF000_0000);
        }
        say!("{:08x} {}", sum, class.name);
    }
    exit()
}

const TRIES: u32 = 500;
