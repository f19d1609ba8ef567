//! Whether the session is connected to a router, without which nodes do not find each other.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use tracing::{info, warn};
use zenoh::{Session, Wait as _};

use super::place::RouterPlace;

/// How long a result stays valid.
const CHECK_PERIOD: Duration = Duration::from_secs(1);
/// How long the first connection may take before its absence is reported.
const GRACE: Duration = Duration::from_secs(2);

/// Checks for the router, and reports when it appears and disappears.
pub(super) struct Router {
    /// Where it is expected; `None` if there need not be one.
    expected: Option<RouterPlace>,
    state: Mutex<RouterState>,
}

struct RouterState {
    opened: Instant,
    checked: Option<Instant>,
    /// What was reported last.
    is_connected: Option<bool>,
}

impl Router {
    pub(super) fn new(expected: Option<RouterPlace>) -> Self {
        let state = RouterState { opened: Instant::now(), checked: None, is_connected: None };
        Self { expected, state: Mutex::new(state) }
    }

    /// Why nodes may not find each other; `None` if they do. Changes are logged, each once.
    pub(super) fn problem(&self, session: &Session) -> Option<String> {
        let expected = self.expected.as_ref()?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if state.checked.is_none_or(|last| now.duration_since(last) >= CHECK_PERIOD) {
            state.checked = Some(now);
            let is_connected = session.info().routers_zid().wait().next().is_some();
            let is_known = is_connected || now.duration_since(state.opened) >= GRACE;
            if is_known && state.is_connected.replace(is_connected) != Some(is_connected) {
                report(expected, is_connected);
            }
        }
        (state.is_connected == Some(false)).then(|| format!("no Zenoh router {expected}"))
    }
}

fn report(expected: &RouterPlace, is_connected: bool) {
    if is_connected {
        info!("connected to the Zenoh router {expected}");
    } else {
        let hint = expected.hint();
        warn!(
            hint = hint.as_str(),
            "no Zenoh router {expected}: ROS 2 nodes do not find each other, will keep trying"
        );
    }
}
