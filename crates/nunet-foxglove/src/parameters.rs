//! What clients can read beside messages. They cannot change it.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use foxglove::websocket::{
    AnyClient, GetParametersResponder, Parameter, ParameterHandler, SetParametersResponder,
};
use nunet_core::depth::Scale;
use nunet_types::shortest;

/// The state of a camera.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct CameraState {
    /// Frames per second since the start.
    pub(crate) fps: f64,
    /// `None` before the first frame.
    pub(crate) scale: Option<Scale>,
}

/// The states of all cameras.
#[derive(Debug, Default)]
pub(crate) struct Parameters(Mutex<BTreeMap<String, CameraState>>);

impl Parameters {
    fn states(&self) -> MutexGuard<'_, BTreeMap<String, CameraState>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state of a camera.
    pub(crate) fn update(&self, camera: &str, change: impl FnOnce(&mut CameraState)) {
        let mut states = self.states();
        match states.get_mut(camera) {
            Some(state) => change(state),
            None => change(states.entry(camera.to_owned()).or_default()),
        }
    }

    /// All parameters of all cameras.
    pub(crate) fn all(&self) -> Vec<Parameter> {
        let of_camera = |(camera, state): (&String, &CameraState)| {
            let name = |name: &str| format!("/{camera}/{name}");
            // A rate with more digits would change with each frame.
            let rate = Parameter::float64(name("rate_hz"), (state.fps * 10.0).round() / 10.0);
            let scale = state.scale.iter().flat_map(|scale| {
                [
                    Parameter::float64(name("scale_factor"), shortest(scale.factor)),
                    Parameter::string(name("scale_source"), scale.source.name()),
                    Parameter::string(name("units"), scale.units.name()),
                ]
            });
            std::iter::once(rate).chain(scale).collect::<Vec<_>>()
        };
        self.states().iter().flat_map(of_camera).collect()
    }

    /// Those with one of the names; all if there is no name.
    fn named(&self, names: &[String]) -> Vec<Parameter> {
        let mut all = self.all();
        all.retain(|parameter| names.is_empty() || names.contains(&parameter.name));
        all
    }
}

impl ParameterHandler for Parameters {
    fn get(
        &self,
        _client: AnyClient,
        names: Vec<String>,
        _request_id: Option<String>,
        responder: GetParametersResponder,
    ) {
        responder.respond(self.named(&names));
    }

    /// Answers with the values as they are.
    fn set(
        &self,
        _client: AnyClient,
        parameters: Vec<Parameter>,
        _request_id: Option<String>,
        responder: SetParametersResponder,
    ) {
        let names: Vec<String> = parameters.into_iter().map(|parameter| parameter.name).collect();
        responder.respond(if names.is_empty() { Vec::new() } else { self.named(&names) });
    }
}
