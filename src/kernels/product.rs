//! Products of matrices of any shape, on one thread, by the crate `gemm`.

/// A matrix in row-major order, or the transpose of one.
#[derive(Clone, Copy)]
pub(super) struct Matrix<'a> {
    values: &'a [f32],
    n_rows: usize,
    n_columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    pub fn new(values: &'a [f32], n_rows: usize, n_columns: usize) -> Self {
        assert_eq!(values.len(), n_rows * n_columns);
        Self { values, n_rows, n_columns, row_stride: n_columns, column_stride: 1 }
    }

    pub fn transposed(self) -> Self {
        Self {
            values: self.values,
            n_rows: self.n_columns,
            n_columns: self.n_rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
        }
    }
}

/// `out = a b`, or `out += a b`; `out` is row-major.
pub(super) fn multiply(a: Matrix<'_>, b: Matrix<'_>, out: &mut [f32], is_added: bool) {
    assert_eq!(a.n_columns, b.n_rows);
    assert_eq!(out.len(), a.n_rows * b.n_columns);
    // SAFETY: by `Matrix::new` and `transposed`, element (r, c) of a and b lies at
    // `r * row_stride + c * column_stride < n_rows * n_columns = values.len()`; the same holds for `out` with
    // strides `(b.n_columns, 1)` by the assertion above. `out` is borrowed mutably, so it overlaps neither.
    unsafe {
        gemm::gemm(
            a.n_rows,
            b.n_columns,
            a.n_columns,
            out.as_mut_ptr(),
            1,
            b.n_columns as isize,
            is_added,
            a.values.as_ptr(),
            a.column_stride as isize,
            a.row_stride as isize,
            b.values.as_ptr(),
            b.column_stride as isize,
            b.row_stride as isize,
            1.0,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}
