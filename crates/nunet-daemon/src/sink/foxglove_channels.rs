//! `--foxglove ADDRESS:PORT`: the results as channels of Foxglove.

use nunet_foxglove::{FoxgloveConfig, FoxgloveServer};
use tracing::info;

use super::{Sink, SinkContext};
use crate::exit::{WithHint, cannot_serve};

/// Opens the server for a number of cameras.
///
/// # Errors
/// The address is in use, or is not an address of this machine.
pub(crate) fn open_server(config: FoxgloveConfig, cameras: usize) -> anyhow::Result<FoxgloveServer> {
    let server = FoxgloveServer::open(config, cameras)
        .map_err(|error| cannot_serve("Foxglove", config.address, error))?;
    info!("open ws://{} in Foxglove", server.address());
    Ok(server)
}

/// Opens the sink if `--foxglove` is given.
pub(super) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let Some(server) = context.foxglove else { return Ok(None) };
    let counts = context.message_counts("foxglove");
    let sink = server.add_camera(&context.camera_options(&counts));
    Ok(Some(sink.map_err(|error| WithHint::plain("cannot serve Foxglove").because(error))?))
}

#[cfg(test)]
#[cfg(feature = "foxglove")]
mod tests {
    use super::*;

    #[test]
    fn an_address_in_use_is_an_error_with_a_hint() {
        let free = FoxgloveConfig { address: "127.0.0.1:0".parse().unwrap(), is_public: false };
        let taken = FoxgloveServer::open(free, 1).unwrap();
        let error = open_server(FoxgloveConfig { address: taken.address(), ..free }, 1).err().unwrap();
        let text = crate::exit::chain_text(&error);
        assert!(text.contains(&format!("Foxglove on `{}`", taken.address())), "{text}");
        assert!(text.contains("\nhint: "), "{text}");
    }
}
