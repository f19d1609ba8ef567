//! The flags of the server for Foxglove.

use std::net::SocketAddr;

use clap::Args;
use nunet_foxglove::{FoxgloveConfig, FoxgloveServerError};
use serde::Deserialize;

use super::text::Text;
use crate::exit::{BadArguments, WithHint};

/// The server for Foxglove.
#[derive(Debug, Args, Clone, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct FoxgloveArgs {
    /// Serve the topics of a recording live to Foxglove, at ws://ADDRESS:PORT. Nothing is encoded without
    /// subscribers
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub foxglove: Option<Text<SocketAddr>>,
    /// Allow an address of --foxglove that other machines can reach. Foxglove sends no password: everyone who
    /// can reach it sees all images
    #[arg(long)]
    pub foxglove_public: bool,
}

impl FoxgloveArgs {
    /// As checked values.
    pub(crate) fn config(&self) -> anyhow::Result<Option<FoxgloveConfig>> {
        let Some(Text(address)) = self.foxglove else { return Ok(None) };
        if cfg!(not(feature = "foxglove")) {
            anyhow::bail!(BadArguments::of(&FoxgloveServerError::NotBuilt));
        }
        let config = FoxgloveConfig { address, is_public: self.foxglove_public };
        config.check().map_err(|error| {
            let hint = "pass --foxglove 127.0.0.1:PORT and forward the port with ssh, or allow it: --foxglove-public";
            WithHint::usage(error.to_string(), hint)
        })?;
        Ok(Some(config))
    }
}
