#![expect(
    unsafe_code,
    reason = "calls a session through ONNX Runtime's C interface, because ort's own call allocates"
)]

//! One run of one model file.

use std::ffi::{CString, c_char};
use std::sync::{Arc, Mutex, PoisonError};

use ort::AsPointer;
use ort::sys::OrtValue;

use super::tensor::{Lent, check};
use crate::graph::TensorSpec;

/// A session with the names and pointers of a run laid out once, so that a run allocates nothing on the Rust side.
///
/// The session itself, with the weights in it, may be shared ([`Self::sibling`]). Its runs take turns: not every provider
/// runs one session twice at the same time.
pub(in crate::graph) struct Session {
    session: Arc<Mutex<ort::session::Session>>,
    input_names: Names,
    output_names: Names,
    inputs: Vec<*const OrtValue>,
    outputs: Vec<*mut OrtValue>,
}

// SAFETY: the session is `Send`, and shared behind a lock; the name pointers point into texts that `Names` owns; the value pointers are dead
// between runs.
unsafe impl Send for Session {}

impl Session {
    /// For runs that give all `inputs` and take all `outputs`, in this order.
    pub(in crate::graph) fn new(
        session: ort::session::Session,
        inputs: &[TensorSpec],
        outputs: &[TensorSpec],
    ) -> Result<Self, String> {
        Ok(Self {
            session: Arc::new(Mutex::new(session)),
            input_names: Names::new(inputs)?,
            output_names: Names::new(outputs)?,
            inputs: Vec::with_capacity(inputs.len()),
            outputs: Vec::with_capacity(outputs.len()),
        })
    }

    /// The same session, for runs of somebody else: weights are in memory once.
    pub(in crate::graph) fn sibling(&self) -> Self {
        Self {
            session: Arc::clone(&self.session),
            input_names: Names::of(self.input_names.texts.clone()),
            output_names: Names::of(self.output_names.texts.clone()),
            inputs: Vec::with_capacity(self.inputs.capacity()),
            outputs: Vec::with_capacity(self.outputs.capacity()),
        }
    }

    /// Runs once: reads `inputs`, writes `outputs` where they lie. As many of each as there are names.
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
                return Err("an output's memory is in use as something else".to_owned());
            }
            self.outputs.push(value);
        }
        if self.inputs.len() != self.input_names.len() || self.outputs.len() != self.output_names.len() {
            return Err("a run was given another number of tensors than the model has".to_owned());
        }
        // A panic while the lock was held left nothing half done: the guard is only read through.
        let session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: session and names live in `self`, and nobody else runs the session. Each value lives in a `CallerTensor` or `OwnTensors` that the tokens
        // borrow for `'run`, and so does the memory behind it; no output is read-only, an input, or given twice.
        // Outputs are not null, so ONNX Runtime writes into them and makes none of its own.
        let status = unsafe {
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
        };
        check(status)
    }
}

/// Names as C wants them: the texts, and the pointers to them.
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
