//! Numbers as the bytes of a tensor.

use crate::graph::ElementType;

/// Beyond it not every integer is an `f64`.
const MAX_INTEGER: f64 = 9_007_199_254_740_992.0; // 2^53

/// `values` as elements of type `element`, in this machine's byte order; `None` for a type that is not
/// supported here, and for a value that the type cannot represent.
pub(super) fn element_bytes(values: &[f64], element: ElementType) -> Option<Vec<u8>> {
    macro_rules! integers {
        ($type:ty) => {
            encode(values, |value| {
                let whole = (value.fract() == 0.0 && value.abs() < MAX_INTEGER).then_some(value as i64)?;
                <$type>::try_from(whole).ok().map(<$type>::to_ne_bytes)
            })
        };
    }
    match element {
        ElementType::Float32 => encode(values, |value| Some((value as f32).to_ne_bytes())),
        ElementType::Float64 => encode(values, |value| Some(value.to_ne_bytes())),
        ElementType::Int64 => integers!(i64),
        ElementType::Int32 => integers!(i32),
        ElementType::Int16 => integers!(i16),
        ElementType::Int8 => integers!(i8),
        ElementType::Uint16 => integers!(u16),
        ElementType::Uint8 => integers!(u8),
        ElementType::Bool => encode(values, |value| [0.0, 1.0].contains(&value).then_some([value as u8])),
        ElementType::Float16 | ElementType::Bfloat16 | ElementType::Other => None,
    }
}

fn encode<const N: usize>(values: &[f64], bytes: impl Fn(f64) -> Option<[u8; N]>) -> Option<Vec<u8>> {
    let elements: Option<Vec<[u8; N]>> = values.iter().map(|&value| bytes(value)).collect();
    Some(elements?.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_elements_of_the_tensors_type() {
        assert_eq!(element_bytes(&[1800.0], ElementType::Int64), Some(1800_i64.to_ne_bytes().to_vec()));
        assert_eq!(element_bytes(&[-3.0], ElementType::Int32), Some((-3_i32).to_ne_bytes().to_vec()));
        let floats = [1.5_f32.to_ne_bytes(), 2.0_f32.to_ne_bytes()].concat();
        assert_eq!(element_bytes(&[1.5, 2.0], ElementType::Float32), Some(floats));
        assert_eq!(element_bytes(&[1.0, 0.0], ElementType::Bool), Some(vec![1, 0]));
    }

    #[test]
    fn values_that_a_type_cannot_represent_are_refused() {
        for (value, element) in [
            (1.5, ElementType::Int64),
            (256.0, ElementType::Uint8),
            (-1.0, ElementType::Uint16),
            (2.0, ElementType::Bool),
            (f64::NAN, ElementType::Int32),
            (1.0, ElementType::Float16),
        ] {
            assert_eq!(element_bytes(&[value], element), None, "{value} {element}");
        }
    }
}
