//! The servers of a run: metrics, live view, ROS 2, Foxglove.

use nunet_foxglove::FoxgloveServer;
use nunet_ros2::Ros2Node;
use nunet_telemetry::Metrics;
use nunet_view::{MetricsServer, ViewServer, probe_address};

use crate::config::OutputConfig;
use crate::exit::cannot_serve;
use crate::sink::{foxglove_channels, metrics, ros2, view};

/// What other programs connect to, for all cameras.
pub(super) struct Servers {
    /// Counted only if they are served.
    pub(super) metrics: Option<Metrics>,
    pub(super) view: Option<ViewServer>,
    pub(super) ros2: Option<Ros2Node>,
    pub(super) foxglove: Option<FoxgloveServer>,
    /// Serves until it is dropped.
    _metrics_server: Option<MetricsServer>,
}

impl Servers {
    /// Checks that the configured servers may listen on their addresses. It serves nothing. A port in use may
    /// be that of a running nunetd, so it is no error here.
    pub(super) fn check(config: &OutputConfig) -> anyhow::Result<()> {
        config.addresses().into_iter().try_for_each(|(flag, address)| {
            probe_address(address).map_err(|error| cannot_serve(flag, address, error))
        })
    }

    /// Opens the configured servers for a number of cameras.
    pub(super) fn open(config: &OutputConfig, cameras: usize) -> anyhow::Result<Self> {
        let all = Metrics::default();
        let own = config.metrics.map(|address| metrics::serve(&all, address)).transpose()?;
        let view = config.view.as_ref().map(|config| view::open_server(config, &all)).transpose()?;
        let ros2 = ros2::open_node(&config.ros2)?;
        let foxglove =
            config.foxglove.map(|config| foxglove_channels::open_server(config, cameras)).transpose()?;
        let is_served = own.is_some() || view.is_some();
        Ok(Self { metrics: is_served.then_some(all), view, ros2, foxglove, _metrics_server: own })
    }
}
