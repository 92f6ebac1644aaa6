//! Arithmetic that several modules share: the high half of a product, a symmetric limit, a small linear solver.

use core::ops::{Div, Mul, SubAssign};

/// Upper 32 bits of the 64-bit product, rounded down: one `SMULL`, or on ARMv6-M a library call.
#[inline(always)]
pub(crate) const fn high(a: i32, b: i32) -> i32 {
    ((a as i64 * b as i64) >> 32) as i32
}

/// `x` limited to ±`limit`; the limit is not negative.
#[inline(always)]
pub(crate) const fn clamp(x: i32, limit: i32) -> i32 {
    if x > limit {
        limit
    } else if x < -limit {
        -limit
    } else {
        x
    }
}

/// Whether −limit ≤ value ≤ limit, in one comparison; limits below 2³¹.
#[inline(always)]
pub(crate) const fn within(value: i32, limit: u32) -> bool {
    (value as u32).wrapping_add(limit) <= 2 * limit
}

/// Entries of the lower triangle of a matrix, with its diagonal.
pub(crate) const fn triangle(size: usize) -> usize {
    size * (size + 1) / 2
}

/// Place of an entry of a lower triangle, none above the diagonal.
pub(crate) const fn lower(row: usize, column: usize) -> usize {
    triangle(row) + column
}

/// Solves `matrix · x = vector` in place for the first `size` unknowns, by LDLᵀ decomposition of a symmetric, positive
/// definite matrix, of which only the lower triangle is read. `vector` becomes the solution, the lower triangle the
/// factors. The triangle is given row by row, as [`lower`] counts, so that all sizes share one copy of the code.
///
/// `None` if a pivot is not above `smallest_pivot` times its diagonal element: then the equations do not determine the
/// unknown, or a value is not a number.
#[inline(never)]
pub(crate) fn solve<T>(matrix: &mut [T], vector: &mut [T], size: usize, smallest_pivot: T) -> Option<()>
where
    T: Copy + PartialOrd + SubAssign + Mul<Output = T> + Div<Output = T>,
{
    let size = size.min(vector.len());
    let at = lower;
    for row in 0..size {
        let least = smallest_pivot * matrix[at(row, row)];
        for column in 0..row {
            for k in 0..column {
                let product = matrix[at(row, k)] * matrix[at(column, k)];
                matrix[at(row, column)] -= product;
            }
        }
        // Until here the row holds L·D; with the division it is L, and what it takes off the diagonal is known.
        for column in 0..row {
            let scaled = matrix[at(row, column)];
            matrix[at(row, column)] = scaled / matrix[at(column, column)];
            let product = scaled * matrix[at(row, column)];
            matrix[at(row, row)] -= product;
            let product = matrix[at(row, column)] * vector[column];
            vector[row] -= product;
        }
        if !(matrix[at(row, row)] > least) {
            return None;
        }
    }
    for row in (0..size).rev() {
        vector[row] = vector[row] / matrix[at(row, row)];
        for k in row + 1..size {
            let product = matrix[at(k, row)] * vector[k];
            vector[row] -= product;
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn high_rounds_down() {
        assert_eq!(high(i32::MIN, i32::MIN), 1 << 30);
        assert_eq!(high(-1, 1), -1);
        assert_eq!(high(1 << 20, 1 << 20), 1 << 8);
    }

    #[test]
    fn solve_finds_what_the_equations_were_made_of() {
        let full = [[4.0, 2.0, -1.0], [2.0, 5.0, 0.5], [-1.0, 0.5, 3.0]];
        let x = [1.5, -2.0, 0.25];
        // Only the first three rows count.
        let mut matrix = [f64::NAN; triangle(4)];
        for (row, column) in (0..3).flat_map(|row| (0..=row).map(move |column| (row, column))) {
            matrix[lower(row, column)] = full[row][column];
        }
        let mut vector = [0, 1, 2, 3].map(|i: usize| (0..3).map(|k| full[i.min(2)][k] * x[k]).sum());
        solve(&mut matrix, &mut vector, 3, 1e-9).unwrap();
        for (found, true_value) in vector.iter().zip(x) {
            assert!((found - true_value).abs() < 1e-12, "{vector:?}");
        }
    }

    #[test]
    fn solve_refuses_what_determines_nothing() {
        let refused = |mut matrix: [f32; 3]| solve(&mut matrix, &mut [1.0, 1.0], 2, 1e-6).is_none();
        assert!(refused([1.0, 2.0, 4.0]));
        assert!(refused([1.0, 2.0, 1.0]));
        assert!(refused([f32::NAN, 0.0, 1.0]));
        assert!(refused([0.0, 0.0, 1.0]));
        assert!(!refused([1.0, 0.5, 1.0]));
    }
}
