#![expect(
    unsafe_code,
    reason = "calls a session through ONNX Runtime's C interface, because ort's own call allocates"
)]

//! Runs of one model file.

use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_char};
use std::ptr::NonNull;
use std::sync::{Arc, Mutex, PoisonError};

use ort::AsPointer;
use ort::sys::{OrtEpAssignedSubgraph, OrtValue};

use super::tensor::{Lent, Value, check};
use crate::graph::TensorSpec;

/// An ONNX Runtime session that several [`Session`]s run.
pub(in crate::graph) type SharedSession = Arc<Mutex<ort::session::Session>>;

/// A session with the names and pointers of a run prepared, so that a run allocates nothing on the Rust side.
///
/// The ONNX Runtime session with its weights can be shared ([`Self::share`]). Its runs are serialized,
/// because not every provider can run one session twice at the same time.
pub(in crate::graph) struct Session {
    session: SharedSession,
    input_names: Names,
    output_names: Names,
    inputs: Vec<*const OrtValue>,
    outputs: Vec<*mut OrtValue>,
}

// SAFETY: the session is `Send`, and shared behind a lock; the name pointers point into strings that `Names`
// owns; the value pointers are not used between runs.
unsafe impl Send for Session {}

impl Session {
    /// For runs with all of `inputs` and `outputs`, in this order.
    pub(in crate::graph) fn new(
        session: SharedSession,
        inputs: &[TensorSpec],
        outputs: &[TensorSpec],
    ) -> Result<Self, String> {
        Ok(Self {
            session,
            input_names: Names::new(inputs)?,
            output_names: Names::new(outputs)?,
            inputs: Vec::with_capacity(inputs.len()),
            outputs: Vec::with_capacity(outputs.len()),
        })
    }

    /// The same ONNX Runtime session for another caller: weights are in memory once.
    pub(in crate::graph) fn share(&self) -> Self {
        Self {
            session: Arc::clone(&self.session),
            input_names: Names::of(self.input_names.texts.clone()),
            output_names: Names::of(self.output_names.texts.clone()),
            inputs: Vec::with_capacity(self.inputs.capacity()),
            outputs: Vec::with_capacity(self.outputs.capacity()),
        }
    }

    /// How many nodes of the model each provider executes, by ONNX Runtime's names of providers.
    pub(in crate::graph) fn node_assignment(&self) -> Result<BTreeMap<String, usize>, String> {
        let session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        let (mut parts, mut count) = (std::ptr::null(), 0);
        // SAFETY: the session lives in `self` and is locked; both places may be written.
        check(unsafe {
            (ort::api().Session_GetEpGraphAssignmentInfo)(session.ptr(), &raw mut parts, &raw mut count)
        })?;
        // Without nodes the array may be null.
        let parts = if parts.is_null() {
            &[]
        } else {
            // SAFETY: ONNX Runtime gave `count` pointers, which live as long as the session, which is locked.
            unsafe { std::slice::from_raw_parts(parts, count) }
        };
        let mut assignment = BTreeMap::new();
        for &one in parts {
            // SAFETY: it belongs to this session, as above.
            let (provider, nodes) = unsafe { part(one) }?;
            *assignment.entry(provider).or_default() += nodes;
        }
        Ok(assignment)
    }

    /// Runs once and lets ONNX Runtime allocate the outputs; returns the shape of each.
    pub(in crate::graph) fn output_shapes<'run>(
        &mut self,
        inputs: impl Iterator<Item = Lent<'run>>,
    ) -> Result<Vec<Vec<i64>>, String> {
        self.inputs.clear();
        self.inputs.extend(inputs.map(|lent| lent.value.as_ptr().cast_const()));
        if self.inputs.len() != self.input_names.len() {
            return Err("the run has another number of inputs than the model".to_owned());
        }
        self.outputs.clear();
        self.outputs.resize(self.output_names.len(), std::ptr::null_mut());
        // SAFETY: as in `run`, except that the outputs are null, so ONNX Runtime allocates them and hands
        // them over.
        let ran = unsafe { self.run_prepared() };
        let outputs: Vec<_> = self.outputs.drain(..).filter_map(NonNull::new).map(Value::from_run).collect();
        ran?;
        outputs.iter().map(Value::shape).collect()
    }

    /// Runs once: reads `inputs` and writes `outputs` in place. There is one of each per name.
    pub(in crate::graph) fn run<'run>(
        &mut self,
        inputs: impl Iterator<Item = Lent<'run>>,
        outputs: impl Iterator<Item = Lent<'run>>,
    ) -> Result<(), String> {
        self.inputs.clear();
        self.inputs.extend(inputs.map(|lent| lent.value.as_ptr().cast_const()));
        self.outputs.clear();
        for lent in outputs {
            let value = lent.value.as_ptr();
            let aliased = self.inputs.contains(&value.cast_const()) || self.outputs.contains(&value);
            if !lent.writable || aliased {
                return Err("the memory of an output is used by another tensor".to_owned());
            }
            self.outputs.push(value);
        }
        if self.inputs.len() != self.input_names.len() || self.outputs.len() != self.output_names.len() {
            return Err("the run has another number of tensors than the model".to_owned());
        }
        // SAFETY: there are as many as names. Each value lives in a `CallerTensor` or `OwnTensors` that the
        // tokens borrow for `'run`, and so does its memory; no output is read-only, an input, or given twice.
        // Outputs are not null, so ONNX Runtime writes into them and allocates none of its own.
        unsafe { self.run_prepared() }
    }

    /// Runs with `self.inputs` and `self.outputs`; null outputs are replaced by values that the caller has to
    /// take.
    ///
    /// # Safety
    /// There are as many of each as names. Every value that is not null lives, and so does its memory; no
    /// output is read-only, an input, or there twice.
    unsafe fn run_prepared(&mut self) -> Result<(), String> {
        // A panic while the lock was held left nothing half-written: the guard is only read through.
        let session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: session and names live in `self`, and the session is locked; the values are the caller's
        // responsibility.
        check(unsafe {
            (ort::api().Run)(
                session.ptr().cast_mut(),
                std::ptr::null(),
                self.input_names.as_ptr(),
                self.inputs.as_ptr(),
                self.inputs.len(),
                self.output_names.as_ptr(),
                self.outputs.len(),
                self.outputs.as_mut_ptr(),
            )
        })
    }
}

/// A part of a model: its provider, and how many nodes it has.
///
/// # Safety
/// `part` belongs to a session that is alive.
unsafe fn part(part: *const OrtEpAssignedSubgraph) -> Result<(String, usize), String> {
    let (mut name, mut nodes, mut count) = (std::ptr::null(), std::ptr::null(), 0);
    // SAFETY: the caller's promise; the places may be written.
    check(unsafe { (ort::api().EpAssignedSubgraph_GetEpName)(part, &raw mut name) })?;
    // SAFETY: as above.
    check(unsafe { (ort::api().EpAssignedSubgraph_GetNodes)(part, &raw mut nodes, &raw mut count) })?;
    if name.is_null() {
        return Err("a provider has no name".to_owned());
    }
    // SAFETY: not null, so a string of ONNX Runtime's that ends with 0 and lives as long as the session.
    let name = unsafe { CStr::from_ptr(name) };
    Ok((name.to_string_lossy().into_owned(), count))
}

/// Names for the C interface: the strings, and the pointers to them.
struct Names {
    texts: Vec<CString>,
    pointers: Vec<*const c_char>,
}

impl Names {
    fn new(specs: &[TensorSpec]) -> Result<Self, String> {
        let texts: Vec<_> = specs
            .iter()
            .map(|spec| CString::new(spec.name.as_str()))
            .collect::<Result<_, _>>()
            .map_err(|error| error.to_string())?;
        Ok(Self::of(texts))
    }

    fn of(texts: Vec<CString>) -> Self {
        let pointers = texts.iter().map(|text| text.as_ptr()).collect();
        Self { texts, pointers }
    }

    fn as_ptr(&self) -> *const *const c_char {
        self.pointers.as_ptr()
    }

    fn len(&self) -> usize {
        self.pointers.len()
    }
}
