//! `--view ADDRESS:PORT`: the live view in the browser.

use std::sync::Arc;

use nunet_sink::view::view_sink;
use nunet_telemetry::Metrics;
use nunet_view::{MetricsText, ViewConfig, ViewOptions, ViewServer};
use tracing::info;

use super::{Sink, SinkContext};
use crate::exit::cannot_serve;

/// Opens the server, which serves `metrics` too.
///
/// # Errors
/// The address is in use, or is not an address of this machine.
pub(crate) fn open_server(config: &ViewConfig, metrics: &Metrics) -> anyhow::Result<ViewServer> {
    let ViewConfig { address, token } = config.clone();
    let (has_token, metrics) = (token.is_some(), metrics.clone());
    let text: MetricsText = Arc::new(move || metrics.text());
    let server = ViewServer::open(address, ViewOptions { token, metrics: Some(text) })
        .map_err(|error| cannot_serve("the live view", address, error))?;
    let query = if has_token { "?token=TOKEN" } else { "" };
    info!("live view on {}{query}", server.url());
    Ok(server)
}

/// Opens the sink if `--view` is given.
pub(super) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let name = context.config.name.as_str();
    Ok(context.view.map(|server| view_sink(server, name, context.common.classes)))
}

#[cfg(test)]
mod tests {
    use nunet_view::Token;

    use super::*;

    /// A server on a free port of loopback.
    fn server() -> ViewServer {
        ViewServer::open("127.0.0.1:0".parse().unwrap(), ViewOptions::default()).unwrap()
    }

    #[test]
    fn an_address_in_use_is_an_error_with_a_hint() {
        let taken = server();
        let config = ViewConfig { address: taken.address(), token: None };
        let error = open_server(&config, &Metrics::default()).err().unwrap();
        let text = crate::exit::chain_text(&error);
        assert!(text.contains(&format!("`{}`", taken.address())), "{text}");
        assert!(text.contains("\nhint: choose another port"), "{text}");
    }

    #[test]
    fn an_address_of_another_machine_is_an_error_with_its_own_hint() {
        let token = Some(Token::new("t").unwrap());
        let config = ViewConfig { address: "192.0.2.1:0".parse().unwrap(), token };
        let error = open_server(&config, &Metrics::default()).err().unwrap();
        let text = crate::exit::chain_text(&error);
        assert!(text.contains("\nhint: choose an address of this machine"), "{text}");
    }
}
