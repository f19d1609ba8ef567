//! The server while too many files are open. The limit is that of the process, so this test has its own.
#![cfg(feature = "server")]
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

use std::fs::File;
use std::io::{ErrorKind, Read as _};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use nunet_foxglove::{FoxgloveConfig, FoxgloveServer};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;

/// The test waits no longer for anything.
const TIMEOUT: Duration = Duration::from_secs(60);
const MAX_FILES: u64 = 256;

/// Opens files until no more can be opened.
fn all_files() -> Vec<File> {
    let limit = Rlimit { current: Some(MAX_FILES), maximum: getrlimit(Resource::Nofile).maximum };
    setrlimit(Resource::Nofile, limit).unwrap();
    (0..MAX_FILES).map_while(|_| File::open("/dev/null").ok()).collect()
}

/// Waits until the server closes the connection.
fn wait_for_end(mut client: TcpStream) {
    client.set_read_timeout(Some(TIMEOUT)).unwrap();
    match client.read(&mut [0; 64]) {
        Ok(length) => assert_eq!(length, 0, "it is served"),
        Err(error) => assert_eq!(error.kind(), ErrorKind::ConnectionReset),
    }
}

async fn is_served(address: SocketAddr) -> bool {
    let stream = tokio::net::TcpStream::connect(address).await.unwrap();
    let mut request = format!("ws://{address}/").into_client_request().unwrap();
    request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
    tokio_tungstenite::client_async(request, stream).await.is_ok()
}

#[test]
fn clients_are_served_again_after_too_many_files_were_open() {
    let config = FoxgloveConfig { address: "127.0.0.1:0".parse().unwrap(), is_public: false };
    let server = FoxgloveServer::open(config, 1).unwrap();
    let mut files = all_files();
    assert!(!files.is_empty());
    // With one file left for the client, it is not accepted. With another, it is not connected further.
    files.pop();
    let client = TcpStream::connect(server.address()).unwrap();
    files.pop();
    wait_for_end(client);
    // With three, the library cannot accept the connection, and stops listening.
    files.pop();
    wait_for_end(TcpStream::connect(server.address()).unwrap());
    drop(files);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        assert!(tokio::time::timeout(TIMEOUT, is_served(server.address())).await.unwrap());
    });
}
