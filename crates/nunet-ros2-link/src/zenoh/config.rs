//! The configuration of a session: that of `rmw_zenoh`, or what the environment states.

use std::path::Path;

use zenoh::Config;

use super::place::RouterPlace;
use crate::environment::{Environment, ZenohVariables};
use crate::error::Ros2Error;
use crate::link_name::{LinkName, ZenohEndpoint, is_endpoint};

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
    connect: { endpoints: ["tcp/localhost:7447"], timeout_ms: -1, exit_on_failure: false },
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

/// A session in any mode but that of a client connects in the background, and tries again without end.
const IN_BACKGROUND: [(&str, &str); 2] = [("connect/timeout_ms", "-1"), ("connect/exit_on_failure", "false")];
/// A client tries each router once whenever it is started, and is started again without end. So it must not
/// listen: each start would open further sockets. Nothing connects to a client anyway.
const ONE_ATTEMPT: [(&str, &str); 3] =
    [("connect/timeout_ms", "0"), ("listen/endpoints", "[]"), ("scouting/multicast/listen", "false")];

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
    let mut config = match session_config {
        Some(path) => from_file(path)?,
        None => ros_default()?,
    };
    for setting in config_override.as_deref().unwrap_or_default().split(';') {
        change(&mut config, setting.trim())?;
    }
    // What the user states on the command line counts more than the environment.
    if let Some(router) = endpoint {
        let endpoints = format!("[\"{router}\"]");
        config
            .insert_json5("connect/endpoints", &endpoints)
            .map_err(|_| Ros2Error::Endpoint { value: router.to_owned() })?;
    }
    if let Some(wrong) = listed(&config).into_iter().find(|router| !is_endpoint(router)) {
        return Err(Ros2Error::Endpoint { value: wrong });
    }
    let settings: &[(&str, &str)] = if is_client(&config) { &ONE_ATTEMPT } else { &IN_BACKGROUND };
    settings.iter().try_for_each(|(key, value)| config.insert_json5(key, value)).map_err(unconfigured)?;
    if is_client(&config) && router_place(&config) == Some(RouterPlace::Nowhere) {
        return Err(Ros2Error::NoZenohRouter);
    }
    Ok(config)
}

/// Whether a session is a client, which has no connections but the one to its router.
pub(super) fn is_client(config: &Config) -> bool {
    is_set(config, "mode", "\"client\"")
}

fn is_set(config: &Config, key: &str, value: &str) -> bool {
    config.get_json(key).is_ok_and(|current| current == value)
}

/// The routers that a session connects to, for messages: `tcp/localhost:7447`.
pub(super) fn routers(config: &Config) -> String {
    listed(config).join(", ")
}

/// The same as a list. A configuration may also group them, or have other ones for each mode.
fn listed(config: &Config) -> Vec<String> {
    let endpoints = config.get_json("connect/endpoints").unwrap_or_default();
    let texts = endpoints.split('"').skip(1).step_by(2);
    texts.filter(|part| part.contains('/')).map(str::to_owned).collect()
}

/// Where a session expects a router; `None` if it is one itself and knows of no other.
pub(super) fn router_place(config: &Config) -> Option<RouterPlace> {
    let routers = routers(config);
    if !routers.is_empty() {
        return Some(RouterPlace::At(routers));
    }
    let is_router = is_set(config, "mode", "\"router\"");
    let looks_around = !is_set(config, "scouting/multicast/enabled", "false");
    (!is_router).then_some(if looks_around { RouterPlace::Anywhere } else { RouterPlace::Nowhere })
}

fn ros_default() -> Result<Config, Ros2Error> {
    Config::from_json5(ROS_SETTINGS).map_err(unconfigured)
}

fn unconfigured(error: zenoh::Error) -> Ros2Error {
    failed("configure Zenoh")(error)
}

/// The error of an action that the library failed at.
pub(super) fn failed(action: &'static str) -> impl Fn(zenoh::Error) -> Ros2Error {
    move |error| Ros2Error::Middleware { action, reason: reason_of(&error) }
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

/// What an error says, without the places in the library's source.
pub(super) fn reason_of(error: &zenoh::Error) -> String {
    without_places(&error.to_string())
}

/// Takes out each ` at FILE.rs:LINE.`: an error has one for each of its causes.
fn without_places(text: &str) -> String {
    let mut parts = text.split(" at ");
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(char::is_whitespace).unwrap_or(part.len());
        let (place, rest) = part.split_at(end);
        if place.contains(".rs:") {
            plain.push_str(rest);
        } else {
            plain.extend([" at ", part]);
        }
    }
    plain
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
        assert_eq!(routers_of("zenoh", &plain), "tcp/localhost:7447");
        assert_eq!(routers_of("zenoh:tcp/localhost:7447", &plain), "tcp/localhost:7447");
        assert_eq!(routers_of("zenoh:tcp/10.0.0.1:7447", &plain), "tcp/10.0.0.1:7447");
        let overridden = environment(None, Some("connect/endpoints=[\"tcp/10.0.0.2:1\"];mode=\"client\""));
        assert_eq!(routers_of("zenoh", &overridden), "tcp/10.0.0.2:1");
        assert_eq!(routers_of("zenoh:tcp/10.0.0.1:7447", &overridden), "tcp/10.0.0.1:7447");
        let config = configuration(&LinkName::Zenoh { endpoint: None }, &overridden).unwrap();
        assert_eq!(config.get_json("mode").unwrap(), "\"client\"");
        assert_eq!(config.get_json("scouting/multicast/enabled").unwrap(), "false");
    }

    #[test]
    fn routers_of_the_settings_count_in_whichever_form_they_are_written() {
        for setting in [
            "connect/endpoints=[\"tcp/127.0.0.1:9999\"]",
            "connect={endpoints:[\"tcp/127.0.0.1:9999\"]}",
            "connect = { endpoints: ['tcp/127.0.0.1:9999'], timeout_ms: 5 }",
        ] {
            let overridden = environment(None, Some(setting));
            assert_eq!(routers_of("zenoh", &overridden), "tcp/127.0.0.1:9999", "{setting}");
            assert_eq!(routers_of("zenoh:tcp/10.0.0.1:1", &overridden), "tcp/10.0.0.1:1", "{setting}");
        }
    }

    #[test]
    fn endpoints_of_the_settings_are_checked_like_those_of_the_command_line() {
        for endpoint in ["tcp/[zz]:7447", "tcp/robot", "quic/robot:7447", "tcp/robot:7447?prio=9-1"] {
            let overridden = environment(None, Some(&format!("connect/endpoints=[\"{endpoint}\"]")));
            let error = check(&"zenoh".parse().unwrap(), &overridden).unwrap_err();
            assert!(matches!(&error, Ros2Error::Endpoint { value } if value == endpoint), "{error}");
        }
    }

    #[test]
    fn no_setting_makes_a_session_wait_for_its_router() {
        let waits = "connect/timeout_ms=60000;connect/exit_on_failure=true";
        for (mode, attempts) in [("peer", "-1"), ("router", "-1"), ("client", "0")] {
            let overridden = environment(None, Some(&format!("mode=\"{mode}\";{waits}")));
            let config = configuration(&"zenoh".parse().unwrap(), &overridden).unwrap();
            assert_eq!(config.get_json("connect/timeout_ms").unwrap(), attempts, "{mode}");
            assert_eq!(is_client(&config), mode == "client");
        }
    }

    #[test]
    fn the_place_of_the_router_is_known_without_endpoints_too() {
        let place = |settings: &str| {
            let overridden = environment(None, Some(&format!("connect/endpoints=[];{settings}")));
            configuration(&"zenoh".parse().unwrap(), &overridden).map(|config| router_place(&config))
        };
        let multicast = "scouting/multicast/enabled=true";
        assert_eq!(place("").unwrap(), Some(RouterPlace::Nowhere));
        assert_eq!(place(multicast).unwrap(), Some(RouterPlace::Anywhere));
        assert_eq!(place("mode=\"router\"").unwrap(), None);
        assert_eq!(place(&format!("mode=\"client\";{multicast}")).unwrap(), Some(RouterPlace::Anywhere));
        assert!(matches!(place("mode=\"client\""), Err(Ros2Error::NoZenohRouter)));
    }

    #[test]
    fn reasons_have_no_places_in_source_files() {
        let text = "no address at 10.9.9.9 at /a/zenoh-1.10.2/src/b.rs:7. - Caused by none at c/d.rs:12.";
        assert_eq!(without_places(text), "no address at 10.9.9.9 - Caused by none");
        assert_eq!(without_places("look at it"), "look at it");
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
            assert_eq!(error.kind(), Ros2ErrorKind::Argument);
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
