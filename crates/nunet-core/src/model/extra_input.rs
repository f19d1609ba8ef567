//! Inputs of a foreign network other than its image, as its sidecar feeds them.

use crate::camera::Intrinsics;

/// What a foreign network's additional input is fed with.
#[derive(Debug, Clone, PartialEq)]
pub enum ExtraInput {
    /// The same values for every frame; a single value fills the whole tensor.
    Constant(Vec<f64>),
    /// The camera matrix at the network's size, row by row: 9 elements, or 16 with a fourth row and column of
    /// the identity; as 4 elements `fx, fy, cx, cy`. Pixels.
    Intrinsics,
    /// The inverse of the camera matrix: 9 or 16 elements.
    InverseIntrinsics,
    /// The horizontal focal length at the network's size: 1 element, pixels.
    Fx,
}

impl ExtraInput {
    /// The names of the values that depend on the camera.
    pub(super) const NAMES: [(&str, Self); 3] =
        [("intrinsics", Self::Intrinsics), ("inverse_intrinsics", Self::InverseIntrinsics), ("fx", Self::Fx)];

    /// Whether the value depends on the camera.
    #[must_use]
    pub fn needs_camera(&self) -> bool {
        !matches!(self, Self::Constant(_))
    }

    /// The counts of elements that it can fill, for an error message.
    #[must_use]
    pub fn expected_elements(&self) -> String {
        match self {
            Self::Constant(values) => values.len().to_string(),
            Self::Intrinsics => "4, 9 or 16".to_owned(),
            Self::InverseIntrinsics => "9 or 16".to_owned(),
            Self::Fx => "1".to_owned(),
        }
    }

    /// The values of a tensor of `elements` elements, for a camera at the network's size; `None` for a count
    /// that it cannot fill.
    #[must_use]
    pub fn values(&self, camera: &Intrinsics, elements: usize) -> Option<Vec<f64>> {
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, .. } = *camera;
        let matrix = [[fx_px, 0.0, cx_px], [0.0, fy_px, cy_px], [0.0, 0.0, 1.0]];
        match (self, elements) {
            (Self::Constant(values), _) if values.len() == 1 => Some(vec![values[0]; elements]),
            (Self::Constant(values), count) if values.len() == count => Some(values.clone()),
            (Self::Intrinsics, 4) => Some(vec![fx_px, fy_px, cx_px, cy_px]),
            (Self::Intrinsics, count) => matrix_elements(matrix, count),
            (Self::InverseIntrinsics, count) => {
                let inverse =
                    [[1.0 / fx_px, 0.0, -cx_px / fx_px], [0.0, 1.0 / fy_px, -cy_px / fy_px], [0.0, 0.0, 1.0]];
                matrix_elements(inverse, count)
            }
            (Self::Fx, 1) => Some(vec![fx_px]),
            _ => None,
        }
    }
}

/// A 3x3 matrix as 9 elements, or as 16 within a 4x4 identity; `None` for another count.
fn matrix_elements(matrix: [[f64; 3]; 3], count: usize) -> Option<Vec<f64>> {
    match count {
        9 => Some(matrix.concat()),
        16 => {
            let rows = matrix.map(|[a, b, c]| [a, b, c, 0.0]);
            Some([rows[0], rows[1], rows[2], [0.0, 0.0, 0.0, 1.0]].concat())
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Intrinsics {
        Intrinsics::new(2.0, 4.0, 10.0, 20.0, 20, 40).unwrap()
    }

    #[test]
    fn a_camera_fills_matrices_of_both_sizes_and_lists() {
        let values = |input: ExtraInput, count| input.values(&camera(), count);
        let nine = values(ExtraInput::Intrinsics, 9).unwrap();
        assert_eq!(nine, [2.0, 0.0, 10.0, 0.0, 4.0, 20.0, 0.0, 0.0, 1.0]);
        let sixteen = values(ExtraInput::Intrinsics, 16).unwrap();
        assert_eq!(sixteen[..8], [2.0, 0.0, 10.0, 0.0, 0.0, 4.0, 20.0, 0.0]);
        assert_eq!(sixteen[8..], [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(values(ExtraInput::Intrinsics, 4).unwrap(), [2.0, 4.0, 10.0, 20.0]);
        let inverse = values(ExtraInput::InverseIntrinsics, 9).unwrap();
        assert_eq!(inverse, [0.5, 0.0, -5.0, 0.0, 0.25, -5.0, 0.0, 0.0, 1.0]);
        assert_eq!(values(ExtraInput::Fx, 1).unwrap(), [2.0]);
        for (input, count) in
            [(ExtraInput::Intrinsics, 3), (ExtraInput::InverseIntrinsics, 4), (ExtraInput::Fx, 2)]
        {
            assert_eq!(values(input, count), None);
        }
    }

    #[test]
    fn one_constant_fills_a_tensor_and_a_list_must_have_its_length() {
        assert_eq!(ExtraInput::Constant(vec![7.0]).values(&camera(), 3).unwrap(), [7.0; 3]);
        assert_eq!(ExtraInput::Constant(vec![7.0, 8.0]).values(&camera(), 2).unwrap(), [7.0, 8.0]);
        assert_eq!(ExtraInput::Constant(vec![7.0, 8.0]).values(&camera(), 3), None);
    }
}
