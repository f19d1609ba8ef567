#![expect(
    unsafe_code,
    reason = "lends memory of ours and of the caller to ONNX Runtime, through its C interface"
)]

//! Tensors over memory of this crate and of the caller.
//!
//! An `OrtValue` over memory that it does not own holds an address, a type and a shape; creating or keeping
//! one reads nothing. Memory is accessed only during a run with the value. The rule that keeps this sound:
//! **a run takes only [`Lent`] tokens, and a token borrows the memory it stands for.** A value for an address
//! that the caller has freed is stale but harmless: it takes part in a run again only inside a token that
//! borrows live memory at the same address and of the same length.

use std::ffi::c_void;
use std::marker::PhantomData;
use std::ptr::NonNull;

use ort::AsPointer;
use ort::memory::{AllocationDevice, AllocatorType, MemoryInfo, MemoryType};
use ort::sys::{ONNXTensorElementDataType as OrtElement, OrtTensorTypeAndShapeInfo, OrtValue};

use crate::graph::{ElementType, GraphError, TensorSpec};

/// How many of the caller's addresses are cached for one tensor. Shared-memory pools recycle far fewer
/// chunks; beyond that a value is created per frame, and memory stays bounded.
const MAX_ADDRESSES: usize = 64;

/// An owned `OrtValue`.
pub(super) struct Value(NonNull<OrtValue>);

// SAFETY: an `OrtValue` belongs to no thread; ONNX Runtime reads it from worker threads itself.
unsafe impl Send for Value {}

impl Value {
    /// A value for `spec.bytes()` bytes at `address`, which are not accessed here.
    fn new(address: NonNull<c_void>, bytes: usize, spec: &TensorSpec) -> Result<Self, String> {
        let memory = MemoryInfo::new(AllocationDevice::CPU, 0, AllocatorType::Device, MemoryType::Default)
            .map_err(|error| error.to_string())?;
        let element = ort_element(spec.element).ok_or("the element type has no size")?;
        let mut value = std::ptr::null_mut();
        // SAFETY: all pointers are valid for the call; the value keeps `address` without touching what it
        // points to.
        let status = unsafe {
            (ort::api().CreateTensorWithDataAsOrtValue)(
                memory.ptr(),
                address.as_ptr(),
                bytes,
                spec.shape.as_ptr(),
                spec.shape.len(),
                element,
                &raw mut value,
            )
        };
        check(status)?;
        NonNull::new(value).map(Self).ok_or_else(|| "no value was created".to_owned())
    }

    /// A value that a run has allocated.
    pub(super) fn from_run(value: NonNull<OrtValue>) -> Self {
        Self(value)
    }

    /// Its dimensions.
    pub(super) fn shape(&self) -> Result<Vec<i64>, String> {
        let mut info = std::ptr::null_mut();
        // SAFETY: the value is alive; the place may be written.
        check(unsafe { (ort::api().GetTensorTypeAndShape)(self.0.as_ptr(), &raw mut info) })?;
        let dimensions = dimensions(info);
        // SAFETY: returned by `GetTensorTypeAndShape`, released once.
        unsafe { (ort::api().ReleaseTensorTypeAndShapeInfo)(info) };
        dimensions
    }
}

fn dimensions(info: *const OrtTensorTypeAndShapeInfo) -> Result<Vec<i64>, String> {
    let mut count = 0;
    // SAFETY: `info` comes from `GetTensorTypeAndShape` and is alive; the place may be written.
    check(unsafe { (ort::api().GetDimensionsCount)(info, &raw mut count) })?;
    let mut dimensions = vec![0; count];
    // SAFETY: as above; there is room for `count` dimensions.
    check(unsafe { (ort::api().GetDimensions)(info, dimensions.as_mut_ptr(), count) })?;
    Ok(dimensions)
}

impl Drop for Value {
    fn drop(&mut self) {
        // SAFETY: created by `CreateTensorWithDataAsOrtValue` or a run, and released once.
        unsafe { (ort::api().ReleaseValue)(self.0.as_ptr()) }
    }
}

/// A tensor's memory, lent to ONNX Runtime for as long as `'run`.
#[derive(Clone, Copy)]
pub(in crate::graph) struct Lent<'run> {
    pub(super) value: NonNull<OrtValue>,
    pub(super) writable: bool,
    memory: PhantomData<&'run mut [u8]>,
}

/// The element types that callers lend.
pub(in crate::graph) trait Element: Copy {
    const TYPE: ElementType;
}

impl Element for u8 {
    const TYPE: ElementType = ElementType::Uint8;
}

impl Element for f32 {
    const TYPE: ElementType = ElementType::Float32;
}

/// A tensor whose memory the caller provides for each run: the image, the depth map, the labels, the
/// confidence.
pub(in crate::graph) struct CallerTensor {
    role: &'static str,
    spec: TensorSpec,
    bytes: usize,
    known: Vec<(usize, Value)>,
    oldest: usize,
}

impl CallerTensor {
    /// For a tensor of `spec`, whose bytes must be countable; `role` is its name in errors.
    pub(in crate::graph) fn new(role: &'static str, spec: TensorSpec) -> Self {
        let bytes = spec.bytes().unwrap_or(0);
        Self { role, spec, bytes, known: Vec::with_capacity(MAX_ADDRESSES), oldest: 0 }
    }

    /// Lends memory that a run may read.
    pub(in crate::graph) fn lend<'run, T: Element>(
        &'run mut self,
        memory: &'run [T],
    ) -> Result<Lent<'run>, GraphError> {
        let address = NonNull::from(memory).cast::<c_void>();
        self.lend_at::<T>(address, memory.len(), false)
    }

    /// Lends memory that a run may write.
    pub(in crate::graph) fn lend_mut<'run, T: Element>(
        &'run mut self,
        memory: &'run mut [T],
    ) -> Result<Lent<'run>, GraphError> {
        let len = memory.len();
        let address = NonNull::from(memory).cast::<c_void>();
        self.lend_at::<T>(address, len, true)
    }

    fn lend_at<T: Element>(
        &mut self,
        address: NonNull<c_void>,
        len: usize,
        writable: bool,
    ) -> Result<Lent<'_>, GraphError> {
        if T::TYPE != self.spec.element {
            return Err(GraphError::ElementType {
                tensor: self.role,
                expected: self.spec.element,
                got: T::TYPE,
            });
        }
        if len * size_of::<T>() != self.bytes {
            let expected = self.bytes / size_of::<T>();
            return Err(GraphError::Buffer { tensor: self.role, got: len, expected });
        }
        let value = self
            .value_at(address)
            .map_err(|reason| GraphError::Tensor { tensor: self.role.to_owned(), reason: reason.into() })?;
        Ok(Lent { value, writable, memory: PhantomData })
    }

    /// The value for an address: cached, or created now in place of the oldest one.
    fn value_at(&mut self, address: NonNull<c_void>) -> Result<NonNull<OrtValue>, String> {
        let key = address.as_ptr() as usize;
        if let Some((_, value)) = self.known.iter().find(|(known, _)| *known == key) {
            return Ok(value.0);
        }
        let value = Value::new(address, self.bytes, &self.spec)?;
        let pointer = value.0;
        if self.known.len() < MAX_ADDRESSES {
            self.known.push((key, value));
        } else {
            self.known[self.oldest] = (key, value);
            self.oldest = (self.oldest + 1) % MAX_ADDRESSES;
        }
        Ok(pointer)
    }
}

/// 64 bytes, the alignment that ONNX Runtime uses for its own memory.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct AlignedBlock([u8; 64]);

/// A tensor in our own memory.
struct OwnTensor {
    memory: NonNull<[AlignedBlock]>,
    bytes: usize,
    value: Value,
}

// SAFETY: the memory is owned by this struct alone, and `Value` is `Send`.
unsafe impl Send for OwnTensor {}

impl OwnTensor {
    fn new(spec: &TensorSpec) -> Result<Self, String> {
        let bytes = spec.bytes().ok_or("its size is not known")?;
        let lines: Box<[AlignedBlock]> = vec![AlignedBlock([0; 64]); bytes.div_ceil(64).max(1)].into();
        let memory = NonNull::from(Box::leak(lines));
        // Created before the value, so that the memory is freed if that fails.
        let guard = OwnedLines(memory);
        let value = Value::new(memory.cast(), bytes, spec)?;
        std::mem::forget(guard);
        Ok(Self { memory, bytes, value })
    }
}

impl Drop for OwnTensor {
    fn drop(&mut self) {
        drop(OwnedLines(self.memory));
    }
}

/// Frees leaked lines.
struct OwnedLines(NonNull<[AlignedBlock]>);

impl Drop for OwnedLines {
    fn drop(&mut self) {
        // SAFETY: leaked from a `Box` by `OwnTensor::new`, freed once.
        drop(unsafe { Box::from_raw(self.0.as_ptr()) });
    }
}

/// The tensors between the stages, results that the caller did not request, state and constants.
pub(in crate::graph) struct OwnTensors(Vec<OwnTensor>);

impl OwnTensors {
    /// Zeroed memory for each tensor of `specs`, in their order. Zeroing also maps it before the first frame.
    pub(in crate::graph) fn new(specs: &[TensorSpec]) -> Result<Self, GraphError> {
        let make = |spec: &TensorSpec| {
            OwnTensor::new(spec)
                .map_err(|reason| GraphError::Tensor { tensor: spec.name.clone(), reason: reason.into() })
        };
        specs.iter().map(make).collect::<Result<_, _>>().map(Self)
    }

    /// Lends all of them. They cannot be read while a token is alive.
    pub(in crate::graph) fn lend(&mut self) -> LentTensors<'_> {
        LentTensors(&self.0)
    }

    /// Writes zeros into one tensor.
    pub(in crate::graph) fn zero(&mut self, index: usize) {
        self.bytes_mut(index).fill(0);
    }

    /// Writes one tensor. `bytes` has its length.
    pub(in crate::graph) fn write(&mut self, index: usize, bytes: &[u8]) {
        self.bytes_mut(index).copy_from_slice(bytes);
    }

    /// The values of one `f32` tensor.
    pub(in crate::graph) fn values(&self, index: usize) -> &[f32] {
        let bytes = self.bytes(index);
        // SAFETY: memory of lines is aligned to 64 bytes, and every bit pattern is an `f32`.
        unsafe { std::slice::from_raw_parts(bytes.as_ptr().cast(), bytes.len() / size_of::<f32>()) }
    }

    /// The bytes of one tensor.
    pub(in crate::graph) fn bytes(&self, index: usize) -> &[u8] {
        let tensor = &self.0[index];
        // SAFETY: `tensor` owns at least that many initialized bytes; runs write them only through tokens of
        // `lend`, which borrows `self` mutably and so cannot be alive beside this view.
        unsafe { std::slice::from_raw_parts(tensor.memory.as_ptr().cast(), tensor.bytes) }
    }

    /// The bytes of one tensor, to be changed.
    pub(in crate::graph) fn bytes_mut(&mut self, index: usize) -> &mut [u8] {
        let tensor = &mut self.0[index];
        // SAFETY: as in `bytes`; `self` is borrowed mutably, so that no token and no other view is alive.
        unsafe { std::slice::from_raw_parts_mut(tensor.memory.as_ptr().cast(), tensor.bytes) }
    }
}

/// [`OwnTensors`] during a run.
#[derive(Clone, Copy)]
pub(in crate::graph) struct LentTensors<'run>(&'run [OwnTensor]);

impl<'run> LentTensors<'run> {
    /// The token of one tensor.
    pub(in crate::graph) fn get(self, index: usize) -> Lent<'run> {
        Lent { value: self.0[index].value.0, writable: true, memory: PhantomData }
    }
}

/// A status of the C interface as a `Result`.
pub(super) fn check(status: ort::sys::OrtStatusPtr) -> Result<(), String> {
    // SAFETY: a status that the C interface has just returned, taken over once.
    unsafe { ort::Error::result_from_status(status) }.map_err(|error| error.to_string())
}

fn ort_element(element: ElementType) -> Option<OrtElement> {
    Some(match element {
        ElementType::Bool => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_BOOL,
        ElementType::Uint8 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_UINT8,
        ElementType::Int8 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_INT8,
        ElementType::Uint16 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_UINT16,
        ElementType::Int16 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_INT16,
        ElementType::Int32 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_INT32,
        ElementType::Int64 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_INT64,
        ElementType::Float16 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT16,
        ElementType::Bfloat16 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_BFLOAT16,
        ElementType::Float32 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT,
        ElementType::Float64 => OrtElement::ONNX_TENSOR_ELEMENT_DATA_TYPE_DOUBLE,
        ElementType::Other => return None,
    })
}
