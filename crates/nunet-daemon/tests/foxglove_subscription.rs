//! Subscribes at the server for Foxglove, for these tests and those of the sink.

use std::net::SocketAddr;

use futures_util::{SinkExt as _, StreamExt as _};
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;

pub(crate) type Socket = WebSocketStream<TcpStream>;

/// Connects, and subscribes to a topic once the server offers it.
pub(crate) async fn subscribe(address: SocketAddr, topic: &str) -> Socket {
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
