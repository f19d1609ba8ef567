//! `/ws`: the frames of one camera at a time, as the client asks for them.

use std::error::Error as _;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::response::{IntoResponse, Response};
use nunet_types::text_with_causes;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, timeout};
use tokio_tungstenite::tungstenite::Error as ReadError;
use tokio_tungstenite::tungstenite::error::{CapacityError, ProtocolError};
use tracing::debug;

use super::watching::{Watching, next_frame};
use super::{ServerState, too_many_viewers};
use crate::camera::{NoCamera, SharedCamera};
use crate::encode::{
    auto_range, encode_bytes, encode_depth, image_jpeg, levels_of, palette, stride_for, subsample, subsampled,
};
use crate::frame::{Encoded, ViewFrame};
use crate::protocol::{
    FrameParts, MAX_REQUEST_BYTES, PROTOCOL_VERSION, Probe, Request, RequestError, Section, ServerMessage,
    Watch, encode,
};

/// How often the state of the stream is checked.
const STATUS_PERIOD: Duration = Duration::from_millis(250);
/// How often a client is pinged; browsers answer pings by themselves.
const PING_PERIOD: Duration = Duration::from_secs(15);
/// A client without a message for this long counts as gone.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(45);
/// Longer messages are refused before they have arrived. Those that are only longer than a request are read,
/// because a connection that is closed with unread bytes is reset, and the client may lose the report.
const MAX_MESSAGE_BYTES: usize = 16 * MAX_REQUEST_BYTES;
/// How long the connection stays open for the client's part of a close.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);

/// Opens a WebSocket.
pub(super) async fn open(
    State(shared): State<ServerState>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade,
        Err(rejection) => return rejection.into_response(),
    };
    let Some(place) = shared.place() else { return too_many_viewers() };
    let upgrade = upgrade.max_message_size(MAX_MESSAGE_BYTES).max_frame_size(MAX_MESSAGE_BYTES);
    upgrade.on_upgrade(move |socket| async move {
        if let Err(error) = Client::new(socket, shared).run().await {
            debug!("a viewer is gone: {error}");
        }
        drop(place);
    })
}

/// One viewer.
struct Client {
    socket: WebSocket,
    shared: ServerState,
    watching: Option<Watching>,
    /// The last frame that was sent.
    shown: Option<Arc<ViewFrame>>,
    heard: Instant,
    pinged: Instant,
    /// The cameras that `hello` named.
    announced: Vec<Arc<SharedCamera>>,
}

/// What a viewer waits for.
enum SocketEvent {
    Message(Option<Result<Message, axum::Error>>),
    Frame(Option<Arc<ViewFrame>>),
    Tick,
}

/// Whether the connection continues.
#[derive(PartialEq)]
enum AfterMessage {
    Continue,
    Close,
}

impl Client {
    fn new(socket: WebSocket, shared: ServerState) -> Self {
        let now = Instant::now();
        Self { socket, shared, watching: None, shown: None, heard: now, pinged: now, announced: Vec::new() }
    }

    /// Serves the viewer, then completes the close of either side: reading answers a client's close, and
    /// waits for the answer to the server's.
    async fn run(mut self) -> Result<(), axum::Error> {
        self.serve().await?;
        self.watching = None;
        let closed = async { while matches!(self.socket.recv().await, Some(Ok(_))) {} };
        // A client that does not answer is disconnected.
        let _ = timeout(CLOSE_TIMEOUT, closed).await;
        Ok(())
    }

    /// Serves the viewer until one side closes. Nothing is read while a frame is being sent. A viewer that
    /// reads nothing is disconnected by the write timeout of its connection.
    async fn serve(&mut self) -> Result<(), axum::Error> {
        self.send_hello().await?;
        let mut ticks = interval(STATUS_PERIOD);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let event = tokio::select! {
                message = self.socket.recv() => SocketEvent::Message(message),
                frame = next_frame(&mut self.watching) => SocketEvent::Frame(frame),
                _ = ticks.tick() => SocketEvent::Tick,
            };
            if self.handle(event).await? == AfterMessage::Close {
                return Ok(());
            }
        }
    }

    /// Names the cameras. At the beginning, and again when one is added, also in the place of another: the
    /// server runs before the cameras do.
    async fn send_hello(&mut self) -> Result<(), axum::Error> {
        let all = self.shared.cameras.all();
        self.announced.clone_from(&all);
        let cameras = all.iter().map(|camera| camera.name.as_str()).collect();
        let palette = palette().as_flattened().to_vec();
        self.say(&ServerMessage::Hello { protocol: PROTOCOL_VERSION, cameras, palette }).await
    }

    async fn handle(&mut self, event: SocketEvent) -> Result<AfterMessage, axum::Error> {
        match event {
            SocketEvent::Message(None) => Ok(AfterMessage::Close),
            SocketEvent::Message(Some(Ok(message))) => self.take_message(message).await,
            SocketEvent::Message(Some(Err(error))) => self.take_error(error).await,
            SocketEvent::Frame(Some(frame)) => self.show(frame).await,
            // The camera has ended; its last frame stays.
            SocketEvent::Frame(None) => {
                self.watching.iter_mut().for_each(Watching::pause);
                Ok(AfterMessage::Continue)
            }
            SocketEvent::Tick => self.tick().await,
        }
    }

    async fn take_message(&mut self, message: Message) -> Result<AfterMessage, axum::Error> {
        self.heard = Instant::now();
        match message {
            Message::Text(text) => match Request::parse(&text) {
                Ok(request) => self.answer(request).await,
                Err(error @ RequestError::TooLong { .. }) => {
                    self.refuse(close_code::SIZE, error.to_string()).await
                }
                Err(error) => self.refuse(close_code::POLICY, text_with_causes(&error)).await,
            },
            Message::Binary(_) => {
                let message = "requests are JSON text, not binary messages".to_owned();
                self.refuse(close_code::UNSUPPORTED, message).await
            }
            Message::Close(_) => Ok(AfterMessage::Close),
            Message::Ping(_) | Message::Pong(_) => Ok(AfterMessage::Continue),
        }
    }

    /// Reports what cannot be read, if the client is still there. Nothing can be read afterwards.
    async fn take_error(&mut self, error: axum::Error) -> Result<AfterMessage, axum::Error> {
        let Some((code, message)) = refusal_of(&error) else { return Err(error) };
        self.refuse(code, message).await?;
        if code == close_code::SIZE {
            // The rest of the message may be unread: see MAX_MESSAGE_BYTES.
            sleep(CLOSE_TIMEOUT).await;
        }
        Ok(AfterMessage::Close)
    }

    async fn answer(&mut self, request: Request) -> Result<AfterMessage, axum::Error> {
        match request {
            Request::Watch(watch) => match self.shared.cameras.find(&watch.camera) {
                Ok(camera) => self.watching = Some(Watching::new(camera, watch)),
                Err(reason @ NoCamera::Starting) => {
                    return self.refuse(close_code::AGAIN, reason.to_string()).await;
                }
                Err(reason @ NoCamera::Unknown { .. }) => {
                    return self.refuse(close_code::POLICY, reason.to_string()).await;
                }
            },
            Request::Pause => self.watching.iter_mut().for_each(Watching::pause),
            Request::Probe { u, v } => {
                if let Some(probe) = self.shown.as_deref().and_then(|frame| probe(frame, u, v)) {
                    self.say(&ServerMessage::Probe(probe)).await?;
                }
            }
        }
        Ok(AfterMessage::Continue)
    }

    /// Reports an error and closes.
    async fn refuse(&mut self, code: u16, message: String) -> Result<AfterMessage, axum::Error> {
        self.say(&ServerMessage::Error { message }).await?;
        let close = CloseFrame { code, reason: "the request was refused".into() };
        self.socket.send(Message::Close(Some(close))).await?;
        Ok(AfterMessage::Close)
    }

    async fn show(&mut self, frame: Arc<ViewFrame>) -> Result<AfterMessage, axum::Error> {
        let Some(watching) = &mut self.watching else { return Ok(AfterMessage::Continue) };
        let description = watching.description(&frame);
        let message = encode(&parts(&frame, &watching.watch));
        watching.pacer.sent(message.len(), Instant::now());
        if let Some(description) = description {
            self.socket.send(Message::Text(description.into())).await?;
        }
        self.shown = Some(frame);
        self.socket.send(Message::Binary(message.into())).await?;
        Ok(AfterMessage::Continue)
    }

    async fn tick(&mut self) -> Result<AfterMessage, axum::Error> {
        if !are_same(&self.shared.cameras.all(), &self.announced) {
            self.send_hello().await?;
        }
        if let Some(status) = self.watching.as_mut().and_then(Watching::status) {
            self.socket.send(Message::Text(status.into())).await?;
        }
        if self.heard.elapsed() > SILENCE_TIMEOUT {
            let message = format!("nothing was received for {} s", SILENCE_TIMEOUT.as_secs());
            return self.refuse(close_code::POLICY, message).await;
        }
        if self.pinged.elapsed() > PING_PERIOD {
            self.pinged = Instant::now();
            self.socket.send(Message::Ping(bytes::Bytes::new())).await?;
        }
        Ok(AfterMessage::Continue)
    }

    async fn say(&mut self, report: &ServerMessage<'_>) -> Result<(), axum::Error> {
        self.socket.send(Message::Text(report.to_json().into())).await
    }
}

/// The code of the close and the report for bytes that are no message; `None` if the client is gone.
fn refusal_of(error: &axum::Error) -> Option<(u16, String)> {
    match error.source()?.downcast_ref::<ReadError>()? {
        ReadError::Capacity(CapacityError::MessageTooLong { size, .. }) => {
            Some((close_code::SIZE, RequestError::TooLong { bytes: *size }.to_string()))
        }
        ReadError::Utf8(_) => Some((close_code::INVALID, "the text is not UTF-8".to_owned())),
        ReadError::Protocol(ProtocolError::ResetWithoutClosingHandshake) => None,
        ReadError::Protocol(error) => {
            Some((close_code::PROTOCOL, format!("these bytes are not a message: {error}")))
        }
        _ => None,
    }
}

fn are_same(cameras: &[Arc<SharedCamera>], others: &[Arc<SharedCamera>]) -> bool {
    cameras.len() == others.len() && cameras.iter().zip(others).all(|(one, other)| Arc::ptr_eq(one, other))
}

/// The depth, the label and the confidence at a point of a frame.
fn probe(frame: &ViewFrame, u: f32, v: f32) -> Option<Probe> {
    let (info, depth) = frame.depth()?;
    let at = |share: f32, side: u32| ((share * side as f32) as u32).min(side - 1);
    let (x, y) = (at(u, info.size.width), at(v, info.size.height));
    let index = y as usize * info.size.width as usize + x as usize;
    let depth = depth.get(index).copied().filter(|depth| depth.is_finite());
    let at_index = |map: Option<&[u8]>| map.and_then(|map| map.get(index).copied());
    let (label, confidence) = (at_index(frame.labels()), at_index(frame.confidence()));
    Some(Probe { sequence: frame.sequence, x, y, depth, label, confidence })
}

/// What a viewer receives of a frame.
fn parts(frame: &ViewFrame, watch: &Watch) -> FrameParts {
    let mut sections = Vec::new();
    if let Some((image, _)) = frame.image().filter(|_| watch.image) {
        let stride = stride_for(image.size.width, watch.max_width);
        sections.push((Section::Image, frame.encoded(Encoded::Jpeg(stride), || image_jpeg(frame, stride))));
    }
    let depth = frame.depth();
    let info = depth.map(|(info, _)| info);
    let size = info.map_or(nunet_types::ImageSize::new(0, 0), |info| info.size);
    let stride = stride_for(size.width, watch.max_width);
    let map_size = subsampled(size, stride);
    let values = depth.map_or(&[][..], |(_, values)| values);
    let curve = levels_of(values, info.map_or(nunet_types::Units::None, |info| info.units));
    if depth.is_some() && watch.depth {
        let encode = || encode_depth(&subsample(values, size, stride), map_size, curve);
        sections.push((Section::Depth, frame.encoded(Encoded::Depth(stride), encode)));
    }
    let byte_maps = [
        (watch.labels, frame.labels(), Section::Labels, Encoded::Labels(stride)),
        (watch.confidence, frame.confidence(), Section::Confidence, Encoded::Confidence(stride)),
    ];
    for (_, map, section, key) in byte_maps.into_iter().filter(|(is_wanted, ..)| *is_wanted) {
        let encoded = map.map(|map| frame.encoded(key, || encode_bytes(&subsample(map, size, stride))));
        sections.extend(encoded.map(|bytes| (section, bytes)));
    }
    if let Some(obstacles) = frame.obstacles().filter(|_| watch.obstacles) {
        sections.push((Section::Obstacles, obstacles.to_vec().into()));
    }
    FrameParts {
        sequence: frame.sequence,
        capture_unix_nanos: frame.capture_unix_nanos,
        total_micros: frame.total_micros,
        depth: info,
        map_size,
        stride,
        range: auto_range(frame),
        curve,
        sections,
    }
}
