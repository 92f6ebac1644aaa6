//! Instructions as the decoder hands them to the core: operands extracted, nothing left to shift or mask.

/// Two-operand arithmetic and logic (Armv7-M Architecture Reference Manual, DDI 0403, A5.3.11).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Alu {
    And,
    Bic,
    Orr,
    Orn,
    Eor,
    Add,
    Adc,
    Sbc,
    Sub,
    Rsb,
    Mov,
    Mvn,
    Tst,
    Teq,
    Cmn,
    Cmp,
}

/// Whether an instruction sets the flags.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Set {
    No,
    Yes,
    /// The narrow encodings do except within an IT block.
    OutsideIt,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shift {
    Lsl,
    Lsr,
    Asr,
    Ror,
    Rrx,
}

/// What a load or store moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cell {
    Byte,
    SignedByte,
    Half,
    SignedHalf,
    Word,
}

/// What happens to the base register.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Index {
    Offset,
    Pre,
    Post,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Extend {
    Sxth,
    Uxth,
    Sxtb16,
    Uxtb16,
    Sxtb,
    Uxtb,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bits {
    Rev,
    Rev16,
    Rbit,
    Revsh,
    Clz,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Long {
    Smull,
    Umull,
    Smlal,
    Umlal,
    Umaal,
}

/// Multiplications of the DSP extension with a 32-bit result (A5.3.16). `x` and `y` choose upper halves or exchange
/// them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dsp {
    Smlaxy { x: bool, y: bool },
    Smlad { exchange: bool },
    Smlsd { exchange: bool },
    Smlaw { top: bool },
    Smmla { round: bool },
    Smmls { round: bool },
    Usada8,
}

/// … with a 64-bit sum (A5.3.17).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DspLong {
    Smlalxy { x: bool, y: bool },
    Smlald { exchange: bool },
    Smlsld { exchange: bool },
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Saturating {
    Qadd,
    Qdadd,
    Qsub,
    Qdsub,
}

/// Parallel additions and subtractions (A5.3.14).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lanes {
    Add8,
    Add16,
    Asx,
    Sub8,
    Sub16,
    Sax,
}

/// What becomes of a lane's result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lane {
    Wrap,
    Saturate,
    Halve,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Hint {
    Nop,
    Wfe,
    Wfi,
    Sev,
}

/// Floating-point arithmetic on three registers (A6.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Float3 {
    Mla,
    Mls,
    Nmla,
    Nmls,
    Mul,
    Nmul,
    Add,
    Sub,
    Div,
    Fma,
    Fms,
    Fnma,
    Fnms,
}

/// … on two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Float2 {
    Mov,
    Abs,
    Neg,
    Sqrt,
    /// From half precision, `top` half.
    FromHalf {
        top: bool,
    },
    ToHalf {
        top: bool,
    },
    FromInt {
        signed: bool,
    },
    /// `zero` rounds towards zero, else as FPSCR says.
    ToInt {
        signed: bool,
        zero: bool,
    },
}

/// One decoded instruction. Registers are 0 to 15.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Op {
    Undefined,
    /// `rotated`: the constant came by a rotation, which sets the carry of a logical operation.
    Imm {
        op: Alu,
        set: Set,
        rotated: bool,
        rd: u8,
        rn: u8,
        imm: u32,
    },
    Reg {
        op: Alu,
        set: Set,
        shift: Shift,
        amount: u8,
        rd: u8,
        rn: u8,
        rm: u8,
    },
    ShiftReg {
        shift: Shift,
        set: Set,
        rd: u8,
        rn: u8,
        rm: u8,
    },
    Movt {
        rd: u8,
        imm: u16,
    },
    Adr {
        rd: u8,
        offset: i32,
    },
    MovPc {
        rm: u8,
    },
    AddPc {
        rm: u8,
    },
    Bx {
        rm: u8,
    },
    Blx {
        rm: u8,
    },
    B {
        offset: i32,
    },
    Bcond {
        cond: u8,
        offset: i32,
    },
    Bl {
        offset: i32,
    },
    Cbz {
        nonzero: bool,
        rn: u8,
        offset: u8,
    },
    TableBranch {
        half: bool,
        rn: u8,
        rm: u8,
    },
    It {
        state: u8,
    },
    Load {
        cell: Cell,
        index: Index,
        rt: u8,
        rn: u8,
        offset: i32,
    },
    Store {
        cell: Cell,
        index: Index,
        rt: u8,
        rn: u8,
        offset: i32,
    },
    LoadReg {
        cell: Cell,
        rt: u8,
        rn: u8,
        rm: u8,
        shift: u8,
    },
    StoreReg {
        cell: Cell,
        rt: u8,
        rn: u8,
        rm: u8,
        shift: u8,
    },
    LoadLiteral {
        cell: Cell,
        rt: u8,
        offset: i32,
    },
    LoadDual {
        index: Index,
        rt: u8,
        rt2: u8,
        rn: u8,
        offset: i16,
    },
    StoreDual {
        index: Index,
        rt: u8,
        rt2: u8,
        rn: u8,
        offset: i16,
    },
    LoadMultiple {
        before: bool,
        back: bool,
        rn: u8,
        list: u16,
    },
    StoreMultiple {
        before: bool,
        back: bool,
        rn: u8,
        list: u16,
    },
    LoadExclusive {
        cell: Cell,
        rt: u8,
        rn: u8,
        offset: u16,
    },
    StoreExclusive {
        cell: Cell,
        rd: u8,
        rt: u8,
        rn: u8,
        offset: u16,
    },
    Clrex,
    Extend {
        kind: Extend,
        rd: u8,
        rn: u8,
        rm: u8,
        rotate: u8,
    },
    Mul {
        set: Set,
        rd: u8,
        rn: u8,
        rm: u8,
    },
    Mla {
        subtract: bool,
        rd: u8,
        rn: u8,
        rm: u8,
        ra: u8,
    },
    Long {
        kind: Long,
        low: u8,
        high: u8,
        rn: u8,
        rm: u8,
    },
    /// `ra` 15: nothing is added.
    Dsp {
        kind: Dsp,
        rd: u8,
        rn: u8,
        rm: u8,
        ra: u8,
    },
    DspLong {
        kind: DspLong,
        low: u8,
        high: u8,
        rn: u8,
        rm: u8,
    },
    Div {
        signed: bool,
        rd: u8,
        rn: u8,
        rm: u8,
    },
    Extract {
        signed: bool,
        rd: u8,
        rn: u8,
        lsb: u8,
        width: u8,
    },
    /// `rn` 15 clears.
    Insert {
        rd: u8,
        rn: u8,
        lsb: u8,
        width: u8,
    },
    Saturate {
        signed: bool,
        rd: u8,
        rn: u8,
        shift: Shift,
        amount: u8,
        bits: u8,
    },
    Saturate16 {
        signed: bool,
        rd: u8,
        rn: u8,
        bits: u8,
    },
    Bits {
        kind: Bits,
        rd: u8,
        rm: u8,
    },
    Parallel {
        lanes: Lanes,
        lane: Lane,
        signed: bool,
        rd: u8,
        rn: u8,
        rm: u8,
    },
    Sel {
        rd: u8,
        rn: u8,
        rm: u8,
    },
    Saturating {
        kind: Saturating,
        rd: u8,
        rn: u8,
        rm: u8,
    },
    Pack {
        top: bool,
        rd: u8,
        rn: u8,
        rm: u8,
        amount: u8,
    },
    Cps {
        disable: bool,
        primask: bool,
        faultmask: bool,
    },
    Mrs {
        rd: u8,
        special: u8,
    },
    Msr {
        rn: u8,
        special: u8,
        mask: u8,
    },
    Svc,
    Bkpt {
        imm: u8,
    },
    Hint(Hint),
    Barrier,
    Float3 {
        op: Float3,
        d: u8,
        n: u8,
        m: u8,
    },
    Float2 {
        op: Float2,
        d: u8,
        m: u8,
    },
    FloatImm {
        d: u8,
        bits: u32,
    },
    /// `quiet`: only a signalling NaN is an invalid operation. `m` `None` compares with zero.
    FloatCompare {
        d: u8,
        m: Option<u8>,
    },
    /// To or from fixed point with `fraction` bits of 16 or 32.
    FloatFixed {
        to_fixed: bool,
        signed: bool,
        half: bool,
        fraction: u8,
        d: u8,
    },
    FloatLoad {
        double: bool,
        d: u8,
        rn: u8,
        offset: i16,
    },
    FloatStore {
        double: bool,
        d: u8,
        rn: u8,
        offset: i16,
    },
    FloatLoadMultiple {
        before: bool,
        back: bool,
        rn: u8,
        first: u8,
        count: u8,
    },
    FloatStoreMultiple {
        before: bool,
        back: bool,
        rn: u8,
        first: u8,
        count: u8,
    },
    FloatToCore {
        rt: u8,
        n: u8,
    },
    FloatFromCore {
        rt: u8,
        n: u8,
    },
    /// Two single registers, `m` and the next.
    FloatPair {
        to_core: bool,
        rt: u8,
        rt2: u8,
        m: u8,
    },
    /// `rt` 15: into the flags.
    Vmrs {
        rt: u8,
    },
    Vmsr {
        rt: u8,
    },
}
