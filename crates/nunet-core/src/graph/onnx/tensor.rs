#![expect(
    unsafe_code,
    reason = "lends memory of ours and of the caller to ONNX Runtime, through its C interface"
)]

//! Memory as ONNX Runtime sees it.
//!
//! An `OrtValue` over memory that is not its own holds an address, a type and a shape; making or keeping one reads
//! nothing. Memory is touched only while a run is given the value. So the rule that keeps this sound is: **a run takes
//! [`Lent`] tokens alone, and a token borrows the memory it stands for.** A value that is kept for an address which the
//! caller has since given up is stale, and harmless: it comes into a run again only inside a token that borrows live
//! memory at that same address and of the same length.

use std::ffi::c_void;
use std::marker::PhantomData;
use std::ptr::NonNull;

use ort::AsPointer;
use ort::memory::{AllocationDevice, AllocatorType, MemoryInfo, MemoryType};
use ort::sys::{ONNXTensorElementDataType as OrtElement, OrtValue};

use crate::graph::{ElementType, GraphError, TensorSpec};

/// How many addresses of the caller are remembered for one tensor. Shared-memory pools recycle far fewer chunks; more
/// than that costs a value a frame, not memory without end.
const MAX_ADDRESSES: usize = 64;

/// An `OrtValue` that is ours to release.
struct Value(NonNull<OrtValue>);

// SAFETY: an `OrtValue` belongs to no thread; ONNX Runtime reads it from worker threads itself.
unsafe impl Send for Value {}

impl Value {
    /// A value that stands for `spec.bytes()` bytes at `address`, which are not touched here.
    fn new(address: NonNull<c_void>, bytes: usize, spec: &TensorSpec) -> Result<Self, String> {
        let memory = MemoryInfo::new(AllocationDevice::CPU, 0, AllocatorType::Device, MemoryType::Default)
            .map_err(|error| error.to_string())?;
        let element = ort_element(spec.element).ok_or("the element type has no size")?;
        let mut value = std::ptr::null_mut();
        // SAFETY: all pointers are valid for the call; the value keeps `address` without touching what it points to.
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
        NonNull::new(value).map(Self).ok_or_else(|| "no value was made".to_owned())
    }
}

impl Drop for Value {
    fn drop(&mut self) {
        // SAFETY: made by `CreateTensorWithDataAsOrtValue`, released once; it does not own the memory it stands for.
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

/// A tensor whose memory the caller gives anew for each run: the picture, the depth map, the labels.
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
            .map_err(|reason| GraphError::Tensor { tensor: self.role.to_owned(), reason })?;
        Ok(Lent { value, writable, memory: PhantomData })
    }

    /// The value for an address: kept from an earlier run, or made now in place of the one made longest ago.
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

/// 64 bytes, so that memory of ours is aligned as ONNX Runtime aligns its own.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line([u8; 64]);

/// A tensor in memory of ours.
struct OwnTensor {
    memory: NonNull<[Line]>,
    bytes: usize,
    value: Value,
}

// SAFETY: the memory is owned by this struct alone, and `Value` is `Send`.
unsafe impl Send for OwnTensor {}

impl OwnTensor {
    fn new(spec: &TensorSpec) -> Result<Self, String> {
        let bytes = spec.bytes().ok_or("its size is not known")?;
        let lines: Box<[Line]> = vec![Line([0; 64]); bytes.div_ceil(64).max(1)].into();
        let memory = NonNull::from(Box::leak(lines));
        // Built before the value, so that the memory is given back where making the value fails.
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

/// Gives leaked lines back.
struct OwnedLines(NonNull<[Line]>);

impl Drop for OwnedLines {
    fn drop(&mut self) {
        // SAFETY: leaked from a `Box` by `OwnTensor::new`, given back once.
        drop(unsafe { Box::from_raw(self.0.as_ptr()) });
    }
}

/// The tensors between the stages, and results that the caller did not ask for.
pub(in crate::graph) struct OwnTensors(Vec<OwnTensor>);

impl OwnTensors {
    /// Zeroed memory for each tensor of `specs`, in their order; that also touches it before the first frame.
    pub(in crate::graph) fn new(specs: &[TensorSpec]) -> Result<Self, GraphError> {
        let make = |spec: &TensorSpec| {
            OwnTensor::new(spec).map_err(|reason| GraphError::Tensor { tensor: spec.name.clone(), reason })
        };
        specs.iter().map(make).collect::<Result<_, _>>().map(Self)
    }

    /// Lends all of them: nobody can look into them while a token lives.
    pub(in crate::graph) fn lend(&mut self) -> LentTensors<'_> {
        LentTensors(&self.0)
    }

    /// Writes zeros into one tensor.
    pub(in crate::graph) fn zero(&mut self, index: usize) {
        let tensor = &self.0[index];
        // SAFETY: `tensor` owns at least that many bytes, and `self` is borrowed mutably: no token and no view lives.
        unsafe { std::ptr::write_bytes(tensor.memory.as_ptr().cast::<u8>(), 0, tensor.bytes) };
    }

    /// The bytes of one tensor.
    pub(in crate::graph) fn bytes(&self, index: usize) -> &[u8] {
        let tensor = &self.0[index];
        // SAFETY: `tensor` owns at least that many initialised bytes; runs write them only through tokens of `lend`,
        // which borrows `self` mutably and so cannot be alive beside this view.
        unsafe { std::slice::from_raw_parts(tensor.memory.as_ptr().cast(), tensor.bytes) }
    }
}

/// [`OwnTensors`] in the hands of a run.
#[derive(Clone, Copy)]
pub(in crate::graph) struct LentTensors<'run>(&'run [OwnTensor]);

impl<'run> LentTensors<'run> {
    /// The token of one tensor.
    pub(in crate::graph) fn get(self, index: usize) -> Lent<'run> {
        Lent { value: self.0[index].value.0, writable: true, memory: PhantomData }
    }
}

/// A status of the C interface as a result.
pub(super) fn check(status: ort::sys::OrtStatusPtr) -> Result<(), String> {
    // SAFETY: a status fresh from the C interface, taken over once.
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
