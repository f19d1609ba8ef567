//! The configuration of a session: that of `rmw_zenoh`, or what the environment states.

use std::path::Path;

use zenoh::Config;

use crate::environment::{Environment, ZenohVariables};
use crate::error::Ros2Error;
use crate::link_name::{LinkName, ZenohEndpoint};

/// Where the router is unless something else is stated.
const ROUTER: &str = "tcp/localhost:7447";
/// A configuration has a few kilobytes.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// What `DEFAULT_RMW_ZENOH_SESSION_CONFIG.json5` of `rmw_zenoh_cpp` states other than Zenoh's defaults:
/// - peers find each other by the router, and a missing router is retried without end;
/// - messages have timestamps, which publishers that keep messages need;
/// - times are long, because many nodes may start together;
/// - other sessions may read what this one counts, and so can this one.
///
/// Two things differ from it. Messages are limited in size, as over DDS, so that no peer takes all memory.
/// And a queue has 1 MB instead of 128 kB, and may take 200 ms instead of 50 ms to take a large message:
/// images were lost on a busy machine, and only a thread that has nothing else to do waits.
const ROS_SETTINGS: &str = r#"{
    mode: "peer",
    connect: { timeout_ms: -1, exit_on_failure: false },
    listen: { endpoints: ["tcp/localhost:0"] },
    scouting: {
        multicast: { enabled: false },
        gossip: {
            enabled: true,
            target: { router: ["router", "peer"], peer: ["router"] },
            autoconnect_strategy: { peer: { to_router: "always", to_peer: "greater-zid" } },
        },
    },
    timestamping: { enabled: true },
    queries_default_timeout: 60000,
    transport: {
        unicast: {
            open_timeout: 60000,
            accept_timeout: 60000,
            accept_pending: 10000,
            max_sessions: 10000,
        },
        link: {
            tx: {
                lease: 60000,
                keep_alive: 2,
                queue: {
                    size: { data: 16 },
                    congestion_control: { drop: { max_wait_before_drop_fragments: 200000 } },
                },
            },
            rx: { max_message_size: 134283264 },
        },
        shared_memory: { enabled: false },
    },
    adminspace: { enabled: true, permissions: { read: true, write: false } },
}"#;

/// Whether a session can be configured: the file and the settings of the environment.
pub(crate) fn check(name: &LinkName, environment: &Environment) -> Result<(), Ros2Error> {
    configuration(name, environment).map(drop)
}

/// The configuration of a session.
pub(super) fn configuration(name: &LinkName, environment: &Environment) -> Result<Config, Ros2Error> {
    let ZenohVariables { session_config, config_override, .. } = &environment.zenoh;
    let endpoint = match name {
        LinkName::Zenoh { endpoint } => endpoint.as_ref().map(ZenohEndpoint::as_str),
        LinkName::Dds { .. } => None,
    };
    let (mut config, router) = match session_config {
        Some(path) => (from_file(path)?, endpoint),
        None => (ros_default()?, Some(endpoint.unwrap_or(ROUTER))),
    };
    for setting in config_override.as_deref().unwrap_or_default().split(';') {
        change(&mut config, setting.trim())?;
    }
    // What the user states on the command line counts more than the environment, unless that names routers.
    let is_overridden = config_override.as_deref().is_some_and(|all| all.contains("connect/endpoints"));
    if let Some(router) = router.filter(|_| endpoint.is_some() || !is_overridden) {
        let endpoints = format!("[\"{router}\"]");
        config
            .insert_json5("connect/endpoints", &endpoints)
            .map_err(|_| Ros2Error::Endpoint { value: router.to_owned() })?;
    }
    Ok(config)
}

/// The routers that a session connects to, for messages: `tcp/localhost:7447`.
pub(super) fn routers(config: &Config) -> String {
    let endpoints = config.get_json("connect/endpoints").unwrap_or_default();
    let listed: Vec<_> = endpoints.split('"').skip(1).step_by(2).filter(|part| part.contains('/')).collect();
    listed.join(", ")
}

fn ros_default() -> Result<Config, Ros2Error> {
    let refused = |error: zenoh::Error| {
        let action = "configure Zenoh";
        Ros2Error::Middleware { action, reason: reason_of(&error) }
    };
    Config::from_json5(ROS_SETTINGS).map_err(refused)
}

fn from_file(path: &Path) -> Result<Config, Ros2Error> {
    let refused = |reason: String| Ros2Error::ZenohFile { path: path.to_owned(), reason };
    let file = std::fs::metadata(path).map_err(|error| refused(error.to_string()))?;
    if !file.is_file() || file.len() > MAX_FILE_BYTES {
        return Err(refused(format!("not a file of at most {MAX_FILE_BYTES} bytes")));
    }
    Config::from_file(path).map_err(|error| refused(reason_of(&error)))
}

/// Applies one `KEY=VALUE` of `ZENOH_CONFIG_OVERRIDE`.
fn change(config: &mut Config, setting: &str) -> Result<(), Ros2Error> {
    if setting.is_empty() {
        return Ok(());
    }
    let refused = |reason: String| Ros2Error::ZenohSetting { setting: setting.to_owned(), reason };
    let (key, value) = setting.split_once('=').ok_or_else(|| refused("it has no `=`".to_owned()))?;
    let (key, value) = (key.trim(), value.trim());
    let current = config.get_json(key).map_err(|_| refused("Zenoh has no such setting".to_owned()))?;
    let unusable = |_| refused(format!("expected a JSON5 value of the kind of the current one, {current}"));
    config.insert_json5(key, value).map_err(unusable)
}

/// What an error says, without the place in the library's source.
pub(super) fn reason_of(error: &zenoh::Error) -> String {
    let text = error.to_string();
    let plain = text.rsplit_once(" at /").filter(|(_, place)| place.contains(".rs:"));
    plain.map_or_else(|| text.clone(), |(reason, _)| reason.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Ros2ErrorKind;

    fn environment(session_config: Option<&Path>, config_override: Option<&str>) -> Environment {
        let zenoh = ZenohVariables {
            session_config: session_config.map(Path::to_owned),
            config_override: config_override.map(str::to_owned),
            router_check_attempts: 1,
        };
        Environment { zenoh, ..Environment::default() }
    }

    fn routers_of(name: &str, environment: &Environment) -> String {
        routers(&configuration(&name.parse().unwrap(), environment).unwrap())
    }

    #[test]
    fn the_router_is_that_of_this_machine_unless_another_is_stated() {
        let plain = environment(None, None);
        assert_eq!(routers_of("zenoh", &plain), ROUTER);
        assert_eq!(routers_of("zenoh:tcp/localhost:7447", &plain), ROUTER);
        assert_eq!(routers_of("zenoh:tcp/10.0.0.1:7447", &plain), "tcp/10.0.0.1:7447");
        let overridden = environment(None, Some("connect/endpoints=[\"tcp/10.0.0.2:1\"];mode=\"client\""));
        assert_eq!(routers_of("zenoh", &overridden), "tcp/10.0.0.2:1");
        assert_eq!(routers_of("zenoh:tcp/10.0.0.1:7447", &overridden), "tcp/10.0.0.1:7447");
        let config = configuration(&LinkName::Zenoh { endpoint: None }, &overridden).unwrap();
        assert_eq!(config.get_json("mode").unwrap(), "\"client\"");
        assert_eq!(config.get_json("scouting/multicast/enabled").unwrap(), "false");
    }

    #[test]
    fn a_file_takes_the_place_of_the_default() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("session.json5");
        std::fs::write(&path, "{ mode: 'client', connect: { endpoints: ['tcp/10.0.0.3:7447'] } }").unwrap();
        assert_eq!(routers_of("zenoh", &environment(Some(&path), None)), "tcp/10.0.0.3:7447");
    }

    #[test]
    fn files_and_settings_that_cannot_be_used_are_errors_with_their_name() {
        let folder = tempfile::tempdir().unwrap();
        let bad = folder.path().join("bad.json5");
        std::fs::write(&bad, "{ mode: 'boat' }").unwrap();
        for path in [folder.path(), &folder.path().join("none.json5"), &bad, Path::new("/dev/zero")] {
            let error =
                check(&LinkName::Zenoh { endpoint: None }, &environment(Some(path), None)).unwrap_err();
            assert_eq!(error.kind(), Ros2ErrorKind::Arguments);
            let expected = format!("cannot read the Zenoh configuration `{}`", path.display());
            assert!(error.to_string().starts_with(&expected), "{error}");
            assert!(!error.to_string().contains(".rs:"), "{error}");
        }
        for setting in ["mode", "mode=boat", "none/of/these=1", "listen/endpoints=[}"] {
            let all = format!("scouting/multicast/enabled=true;{setting}");
            let error =
                check(&LinkName::Zenoh { endpoint: None }, &environment(None, Some(&all))).unwrap_err();
            let expected = format!("ZENOH_CONFIG_OVERRIDE cannot set `{setting}`");
            assert!(error.to_string().starts_with(&expected), "{error}");
        }
    }
}
