//! The names, paths and settings of iceoryx2 in this crate.

use std::fmt;
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Component, Path, PathBuf};
use std::sync::{Once, OnceLock};

use iceoryx2::config::Config;
use iceoryx2::prelude::{
    AttributeVerifier, CallbackProgression, LogLevel, MessagingPattern, Service, ServiceName, ipc_threadsafe,
};
use iceoryx2::service::attribute::AttributeSet;
use iceoryx2::service::service_hash::ServiceHash;

use crate::contract::{CONTRACT_ATTRIBUTE, CONTRACT_VERSION};
use crate::error::{IceoryxCause, IpcError};

/// The thread-safe kind of service: its ports and samples are `Send`, at the price of an uncontended mutex.
pub(crate) type Iceoryx = ipc_threadsafe::Service;

/// The environment variable that names the folder of [`use_root`].
pub const ROOT_VARIABLE: &str = "NUNET_IPC_ROOT";

/// The longest root: it contains the sockets for wake-ups, and Linux limits the path of a socket to 107
/// bytes.
const MAX_ROOT_BYTES: usize = 40;

/// Unit tests have their own root, because the default one may belong to another user.
#[cfg(test)]
const ROOT_OF_UNIT_TESTS: Option<fn() -> PathBuf> = Some(nunet_testkit::ipc_root);
#[cfg(not(test))]
const ROOT_OF_UNIT_TESTS: Option<fn() -> PathBuf> = None;

static ROOT: OnceLock<PathBuf> = OnceLock::new();
static CONFIG: OnceLock<Result<Config, IpcRootError>> = OnceLock::new();

/// Why a folder cannot be the root.
#[derive(Debug, Clone, PartialEq, Eq)]
struct IpcRootError {
    root: PathBuf,
    reason: &'static str,
}

/// Uses `root` instead of `/tmp/iceoryx2` for the files of this process, and a prefix of its own in
/// `/dev/shm`. Publishers and readers see each other only if they use the same root.
///
/// Call it before anything else of this crate. Without it, the variable [`ROOT_VARIABLE`] decides, and where
/// that is not set, iceoryx2's own configuration. The folder is created when it is needed.
///
/// # Errors
/// [`IpcError::Root`] for a path that is not absolute or longer than 40 bytes, and when another root is in
/// use already.
pub fn use_root(root: &Path) -> Result<(), IpcError> {
    let root = &one_spelling(root);
    let requested = ROOT.get_or_init(|| root.clone());
    let in_use = config().global.root_path().to_string();
    check_root()?;
    if requested == root && in_use.as_bytes() == root.as_os_str().as_bytes() {
        return Ok(());
    }
    Err(IpcError::Root { root: root.clone(), reason: "this process already uses another root" })
}

/// # Errors
/// [`IpcError::Root`] where the requested root cannot be used.
pub(crate) fn check_root() -> Result<(), IpcError> {
    let checked = configured().as_ref().map(drop);
    checked.map_err(|IpcRootError { root, reason }| IpcError::Root { root: root.clone(), reason })
}

/// iceoryx2's configuration, the default one where the requested root cannot be used: see [`check_root`].
pub(crate) fn config() -> &'static Config {
    configured().as_ref().unwrap_or_else(|_| Config::global_config())
}

fn configured() -> &'static Result<Config, IpcRootError> {
    silence_logs();
    CONFIG.get_or_init(|| {
        let from_environment = || std::env::var_os(ROOT_VARIABLE).filter(|root| !root.is_empty());
        let from_environment = || from_environment().map(|root| one_spelling(Path::new(&root)));
        let of_tests = || ROOT_OF_UNIT_TESTS.map(|root| root());
        match ROOT.get().cloned().or_else(from_environment).or_else(of_tests) {
            Some(root) => config_in(&root).map_err(|reason| IpcRootError { root, reason }),
            None => Ok(Config::global_config().clone()),
        }
    })
}

/// One spelling for `/x/ipc`, `/x/ipc/`, `//x/ipc`, `/x/./ipc` and `/x/y/../ipc`: processes that spell the
/// root differently would not see each other. Links are not followed, because a short link may stand for a
/// path that is too long.
fn one_spelling(root: &Path) -> PathBuf {
    let mut spelled = PathBuf::new();
    for component in root.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir => drop(spelled.pop()),
            other => spelled.push(other),
        }
    }
    spelled
}

/// The configuration for a root: the names in `/dev/shm`, which all users share, begin with a hash of it.
fn config_in(root: &Path) -> Result<Config, &'static str> {
    if !root.is_absolute() {
        return Err("expected an absolute path");
    }
    let bytes = root.as_os_str().as_bytes();
    if bytes.len() > MAX_ROOT_BYTES {
        return Err("the path is longer than 40 bytes");
    }
    let mut config = Config::global_config().clone();
    let text = root.to_str().ok_or("the path is not UTF-8")?;
    let path = text.try_into().map_err(|_| "iceoryx2 does not accept the path")?;
    config.global.set_root_path(&path);
    let prefix = format!("{}{:08x}_", config.global.prefix, hash(bytes));
    config.global.prefix = prefix.as_str().try_into().map_err(|_| "iceoryx2 does not accept the prefix")?;
    Ok(config)
}

/// FNV-1a, the same in every process and version.
fn hash(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193))
}

/// The folder of iceoryx2's files that are not memory: `/tmp/iceoryx2`, unless [`use_root`] or
/// [`ROOT_VARIABLE`] changed it.
#[must_use]
pub fn root() -> PathBuf {
    PathBuf::from(config().global.root_path().to_string())
}

/// What the names of this root's files in `/dev/shm` begin with.
#[must_use]
pub fn shared_memory_prefix() -> String {
    config().global.prefix.to_string()
}

impl IpcError {
    /// Wraps an error of iceoryx2, whose types do not leave this crate.
    pub(crate) fn iceoryx(action: impl Into<String>, cause: impl fmt::Debug) -> Self {
        Self::Iceoryx { action: action.into(), cause: IceoryxCause::new(&cause, root()) }
    }
}

/// iceoryx2 logs to stdout and stderr by itself. The errors of this crate report every failure, so the log is
/// off by default; `IOX2_LOG_LEVEL` turns it on. It is set only once, so that a program may set its own level
/// afterwards.
fn silence_logs() {
    static SILENCED: Once = Once::new();
    SILENCED.call_once(|| iceoryx2::prelude::set_log_level_from_env_or(LogLevel::Fatal));
}

pub(crate) fn service_name(name: &str) -> Result<ServiceName, IpcError> {
    name.try_into().map_err(|cause| IpcError::iceoryx(format!("name a service `{name}`"), cause))
}

/// The file that describes a service.
pub(crate) fn record_of(name: &str, pattern: MessagingPattern) -> Result<PathBuf, IpcError> {
    let hash = ServiceHash::new::<<Iceoryx as Service>::ServiceNameHasher>(&service_name(name)?, pattern);
    let global = &config().global;
    let file = format!("{}{hash}{}", global.prefix, global.service.static_config_storage_suffix);
    Ok(PathBuf::from(global.service_dir().to_string()).join(file))
}

/// The process that made an id: iceoryx2's `UniqueSystemId` is seconds, nanoseconds, process, counter, 32
/// bits each.
pub(crate) fn pid_of(id: u128) -> u32 {
    (id >> 64) as u32
}

/// The attributes that a service must have. A new service is created with them.
pub(crate) fn contract_attribute() -> Result<AttributeVerifier, IpcError> {
    let failed = |cause: &dyn fmt::Debug| IpcError::iceoryx("define a service attribute", cause);
    let key = CONTRACT_ATTRIBUTE.try_into().map_err(|cause| failed(&cause))?;
    let value = CONTRACT_VERSION.to_string().as_str().try_into().map_err(|cause| failed(&cause))?;
    AttributeVerifier::new().require(&key, &value).map_err(|cause| failed(&cause))
}

/// Refuses a service of another contract version by name.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_root_has_its_own_names_in_shared_memory() {
        let (one, other) =
            (config_in(Path::new("/tmp/one")).unwrap(), config_in(Path::new("/tmp/other")).unwrap());
        assert_eq!(one.global.root_path().to_string(), "/tmp/one");
        let prefixes = [&one, &other, Config::global_config()].map(|config| config.global.prefix.to_string());
        assert!(prefixes[0] != prefixes[1], "{prefixes:?}");
        assert!(prefixes[..2].iter().all(|prefix| prefix.len() > prefixes[2].len()), "{prefixes:?}");
        assert_eq!(config_in(Path::new("/tmp/one")).unwrap().global.prefix, one.global.prefix);
    }

    #[test]
    fn a_root_is_one_root_however_it_is_spelled() {
        for root in ["/x/ipc/", "//x/ipc", "/x/./ipc", "/x//ipc/.", "/x/y/../ipc", "/../x/ipc"] {
            assert_eq!(one_spelling(Path::new(root)).as_os_str(), "/x/ipc", "{root}");
        }
        assert!(config_in(&one_spelling(Path::new("./relative"))).is_err());
    }

    #[test]
    fn a_root_that_cannot_be_used_is_refused() {
        for root in ["relative", "", "/tmp/a-folder-whose-path-is-too-long-for-sockets"] {
            config_in(Path::new(root)).map(drop).unwrap_err();
        }
    }
}
