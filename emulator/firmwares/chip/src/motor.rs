//! A motor firmware as small as can be: a field that turns open loop, and a Hall that tells whether the rotor follows.
//! It can make one of four mistakes.

use crate::{Board, board, calibrate, connect, convert_at_trigger, enable_converters, full_speed};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use cortex_m::peripheral::NVIC;
use stm32_metapac::adc::regs::{Ier, Isr};
use stm32_metapac::timer::regs::{ArrCore, Ccr1ch, RcrAdv};
use stm32_metapac::timer::vals::{Cms, Mms2, Ocm, Ossi, Ossr};
use stm32_metapac::{ADC1, Interrupt, RCC, TIM1};

/// What may be wrong, each alone.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Mistake {
    /// DTG is zero.
    NoDeadTime,
    /// MOE is set before OISx, OISxN, OSSI and OSSR are.
    MoeBeforeIdleStates,
    /// TIM1_CH3N's pin is given the other of the two functions that the boards use.
    WrongAlternateFunction,
    /// ADC12EN stays clear.
    AdcUnclocked,
}

/// 40 kHz at 170 MHz.
const HALF_PERIOD: u32 = 2125;
const PWM_HZ: u32 = 40_000;
/// 500 ns.
const DEAD_TIME: u8 = 85;
/// Amplitude of a leg's duty, counts.
const AMPLITUDE: i32 = 400;
/// Advance of the field in a period once it has its speed, 10 turns a second; and what it gains each period, for half a
/// second.
const STEP: u32 = (10 * (1 << 32) / PWM_HZ as u64) as u32;
const GAIN: u32 = STEP / (PWM_HZ / 2);
/// JEOS of ADC_ISR and ADC_IER.
const END_OF_SEQUENCE: u32 = 1 << 6;

static FIELD: AtomicU32 = AtomicU32::new(0);
static SPEED: AtomicU32 = AtomicU32::new(0);
static FIELD_TURNS: AtomicU32 = AtomicU32::new(0);
static HALL_TURNS: AtomicU32 = AtomicU32::new(0);
static HALL_HIGH: AtomicBool = AtomicBool::new(false);

/// Turns the motor, and logs each turn of the field.
pub fn run(mistake: Option<Mistake>) -> ! {
    let board = board();
    let makes = |which| mistake == Some(which);
    full_speed();
    timer(board, if makes(Mistake::NoDeadTime) { 0 } else { DEAD_TIME });
    if !makes(Mistake::MoeBeforeIdleStates) {
        idle_states(board);
    }
    let mut gates = board.gates;
    if makes(Mistake::WrongAlternateFunction) {
        // Four and six.
        gates[5].2 ^= 2;
    }
    connect(&gates);
    if !makes(Mistake::AdcUnclocked) {
        enable_converters();
    }
    calibrate(ADC1);
    convert_at_trigger(ADC1, [board.bus, board.hall]);
    ADC1.ier().write_value(Ier(END_OF_SEQUENCE));
    TIM1.cr1().modify(|cr1| cr1.set_cen(true));
    TIM1.bdtr().modify(|bdtr| bdtr.set_moe(true));
    if makes(Mistake::MoeBeforeIdleStates) {
        idle_states(board);
    }
    // SAFETY: everything that the handler uses is there.
    unsafe { NVIC::unmask(Interrupt::ADC1_2) };
    let mut told = 0;
    loop {
        cortex_m::asm::wfi();
        let turns = FIELD_TURNS.load(Relaxed);
        if turns != told {
            told = turns;
            defmt::info!("{} turns of the field, {} of the Hall", turns, HALL_TURNS.load(Relaxed));
        }
    }
}

/// Centre-aligned, all legs low in the valley, which triggers the ADCs. Nothing comes out as long as MOE is clear.
fn timer(board: &Board, dead_time: u8) {
    RCC.apb2enr().modify(|enable| enable.set_tim1en(true));
    TIM1.cr1().write(|cr1| {
        cr1.set_cms(Cms::CENTER_ALIGNED1);
        cr1.set_arpe(true);
    });
    TIM1.cr2().write(|cr2| cr2.set_mms2(Mms2::UPDATE));
    TIM1.arr().write_value(ArrCore(HALF_PERIOD));
    // One update a period.
    TIM1.rcr().write_value(RcrAdv(1));
    for leg in 0..3 {
        TIM1.ccmr_output(leg / 2).modify(|ccmr| {
            ccmr.set_ocm(leg % 2, Ocm::PWM_MODE2);
            ccmr.set_ocpe(leg % 2, true);
        });
        TIM1.ccr(leg).write_value(Ccr1ch(HALF_PERIOD / 2));
        TIM1.ccer().modify(|ccer| {
            ccer.set_cce(leg, true);
            ccer.set_ccne(leg, true);
            ccer.set_ccnp(leg, board.low_inverted);
        });
    }
    TIM1.bdtr().write(|bdtr| bdtr.set_dtg(dead_time));
    TIM1.egr().write(|egr| egr.set_ug(true));
}

/// With MOE clear all transistors are off, by levels that the timer drives.
fn idle_states(board: &Board) {
    TIM1.cr2().modify(|cr2| (0..3).for_each(|leg| cr2.set_oisn(leg, board.low_inverted)));
    TIM1.bdtr().modify(|bdtr| {
        bdtr.set_ossi(Ossi::IDLE_LEVEL);
        bdtr.set_ossr(Ossr::IDLE_LEVEL);
    });
}

/// The control interrupt, at the end of ADC1's sequence: turns the field on, off where there is no bus voltage.
pub fn control() {
    ADC1.isr().write_value(Isr(END_OF_SEQUENCE));
    let [bus, hall] = [0, 1].map(|rank| ADC1.jdr(rank).read().jdata());
    if bus < 100 {
        TIM1.bdtr().modify(|bdtr| bdtr.set_moe(false));
    }
    let (high, was_high) = (hall > if HALL_HIGH.load(Relaxed) { 1900 } else { 2200 }, HALL_HIGH.load(Relaxed));
    HALL_HIGH.store(high, Relaxed);
    if high && !was_high {
        HALL_TURNS.fetch_add(1, Relaxed);
    }
    let speed = (SPEED.load(Relaxed) + GAIN).min(STEP);
    SPEED.store(speed, Relaxed);
    let (field, over) = FIELD.load(Relaxed).overflowing_add(speed);
    FIELD.store(field, Relaxed);
    if over {
        FIELD_TURNS.fetch_add(1, Relaxed);
    }
    for leg in 0..3 {
        // A third of a turn from leg to leg.
        let phase = field.wrapping_sub((leg as u32).wrapping_mul(u32::MAX / 3));
        let high = HALF_PERIOD as i32 / 2 + ((AMPLITUDE * sine(phase)) >> 15);
        TIM1.ccr(leg).write_value(Ccr1ch((HALF_PERIOD as i32 - high) as u32));
    }
}

/// Sine of an angle, a turn being 2³², in 2⁻¹⁵, by two parabolas: 0.056 off at most.
fn sine(angle: u32) -> i32 {
    let x = (angle as i32) >> 16;
    (x * ((1 << 15) - x.abs())) >> 13
}
