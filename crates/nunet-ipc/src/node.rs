//! The way into iceoryx2: a node of this process, quiet, and who the others are.

use std::fmt;
use std::sync::Once;

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::prelude::{
    AttributeVerifier, CallbackProgression, LogLevel, ServiceName, SignalHandlingMode, ipc_threadsafe,
};
use iceoryx2::service::attribute::AttributeSet;

use crate::access;
use crate::error::IpcError;
use crate::header::CONTRACT_VERSION;
use crate::mend;

/// The thread-safe kind of service: its ports and samples are `Send`, at the price of a mutex that nobody else
/// competes for.
pub(crate) type Iceoryx = ipc_threadsafe::Service;

/// The attribute that every service of this contract carries.
pub const CONTRACT_ATTRIBUTE: &str = "nunet.contract";

/// A process that takes part in a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Process {
    /// Its id; 0 when iceoryx2 does not tell.
    pub pid: u32,
    /// Whether it runs. A process that was killed keeps its place until somebody cleans up after it.
    pub alive: bool,
}

impl fmt::Display for Process {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = if self.alive { "" } else { ", which is dead" };
        write!(f, "process {}{state}", self.pid)
    }
}

/// Makes a node. Doing so also removes what dead processes left behind: iceoryx2's default, which we keep.
pub(crate) fn create() -> Result<Node<Iceoryx>, IpcError> {
    hush();
    access::check_folder()?;
    let dead = mend::dead_processes();
    mend::remove_unfilled(&dead);
    let node = NodeBuilder::new()
        .signal_handling_mode(SignalHandlingMode::Disabled) // signals belong to the program, not to a library
        .create::<Iceoryx>()
        .map_err(|cause| IpcError::CannotJoin { cause: format!("{cause:?}") })?;
    mend::sweep(&dead);
    Ok(node)
}

/// iceoryx2 logs to stdout and stderr on its own. Our errors say it all; `IOX2_LOG_LEVEL` brings the rest back. Once
/// only, so that a program may set its own level afterwards.
fn hush() {
    static HUSHED: Once = Once::new();
    HUSHED.call_once(|| iceoryx2::prelude::set_log_level_from_env_or(LogLevel::Fatal));
}

pub(crate) fn config() -> &'static Config {
    hush();
    Config::global_config()
}

pub(crate) fn service_name(name: &str) -> Result<ServiceName, IpcError> {
    name.try_into().map_err(|cause| IpcError::iceoryx(format!("name a service `{name}`"), cause))
}

/// What a service's attributes must say, and are made to say where the service is created.
pub(crate) fn contract_attribute() -> Result<AttributeVerifier, IpcError> {
    let failed = |cause: &dyn fmt::Debug| IpcError::iceoryx("define a service attribute", cause);
    let key = CONTRACT_ATTRIBUTE.try_into().map_err(|cause| failed(&cause))?;
    let value = CONTRACT_VERSION.to_string().as_str().try_into().map_err(|cause| failed(&cause))?;
    AttributeVerifier::new().require(&key, &value).map_err(|cause| failed(&cause))
}

/// Refuses a service of another contract by name.
pub(crate) fn check_contract(service: &str, attributes: &AttributeSet) -> Result<(), IpcError> {
    let mut found = "none".to_owned();
    if let Ok(key) = CONTRACT_ATTRIBUTE.try_into() {
        attributes.iter_key_values(&key, |value| {
            found = value.to_string();
            CallbackProgression::Stop
        });
    }
    if found == CONTRACT_VERSION.to_string() {
        return Ok(());
    }
    Err(IpcError::ContractVersion { service: service.to_owned(), found, expected: CONTRACT_VERSION })
}
