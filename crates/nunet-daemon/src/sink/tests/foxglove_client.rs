//! A client of the server for Foxglove.

use std::net::SocketAddr;

use futures_util::{SinkExt as _, StreamExt as _};
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio::runtime::{Builder, Runtime};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;

use super::TIMEOUT;

/// A client that subscribes to a topic and reads no message of it.
pub(super) struct SilentClient {
    _socket: WebSocketStream<TcpStream>,
    /// It runs only in [`SilentClient::subscribe`].
    _runtime: Runtime,
}

impl SilentClient {
    /// Connects, and subscribes to a topic.
    pub(super) fn subscribe(address: SocketAddr, topic: &str) -> Self {
        let runtime = Builder::new_current_thread().enable_all().build().unwrap();
        let socket = runtime.block_on(async {
            tokio::time::timeout(TIMEOUT, subscribed(address, topic)).await.expect("it takes too long")
        });
        Self { _socket: socket, _runtime: runtime }
    }
}

async fn subscribed(address: SocketAddr, topic: &str) -> WebSocketStream<TcpStream> {
    let stream = TcpStream::connect(address).await.unwrap();
    let mut request = format!("ws://{address}/").into_client_request().unwrap();
    request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
    let mut socket = tokio_tungstenite::client_async(request, stream).await.unwrap().0;
    loop {
        let Message::Text(text) = socket.next().await.unwrap().unwrap() else { continue };
        let report: Value = serde_json::from_str(&text).unwrap();
        let mut channels = report["channels"].as_array().into_iter().flatten();
        if let Some(channel) = channels.find(|channel| channel["topic"] == topic) {
            let subscription = json!({"id": 1, "channelId": channel["id"]});
            let request = json!({"op": "subscribe", "subscriptions": [subscription]});
            socket.send(Message::text(request.to_string())).await.unwrap();
            return socket;
        }
    }
}
