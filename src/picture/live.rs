//! A picture in a viewer while it is rendered, by the protocol of tev (Müller 2016), which HDRView reads too.
//!
//! A thread of its own sends what there is to show. A viewer that takes its time misses pictures, but holds up nobody.

use std::io;
use std::net::{Shutdown, TcpStream, ToSocketAddrs};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use bytemuck::cast_slice;
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

use super::address::Address;
use super::window::{Placed, Window};
use crate::base::{Error, Result};
use crate::picture::Image;

/// Time in which a viewer has to answer, for each of the addresses of its host.
const ANSWER: Duration = Duration::from_secs(5);
/// Time without a byte taken after which a viewer is given up.
const STANDSTILL: Duration = Duration::from_secs(10);
/// Numbers in a packet, unless a single row has more: packets of a mebibyte are what tev has room for from the beginning.
const PACKET: usize = 1 << 18;
/// The picture's channels, interleaved.
const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// What is to be shown, before its pixels are known.
#[derive(Debug, Clone)]
pub struct Canvas {
    /// Name of the picture in the viewer, which replaces one of the same name.
    pub name: String,
    /// Columns and rows of the whole picture.
    pub size: [u32; 2],
    /// The part of it that has pixels; none for all.
    pub window: Placed,
}

impl Canvas {
    fn window(&self) -> Window {
        self.window.map_or(Window::whole(self.size), |(window, _)| window)
    }

    /// Sends a black picture, for the viewer to look at.
    fn create(&self, viewer: &mut TevClient) -> io::Result<()> {
        let [width, height] = self.size;
        viewer.send(PacketCreateImage {
            image_name: &self.name,
            grab_focus: true,
            width,
            height,
            channel_names: &CHANNELS,
        })
    }

    /// Sends all pixels, some rows at a time.
    fn update(&self, viewer: &mut TevClient, image: &Image) -> io::Result<()> {
        let window = self.window();
        let rows = (PACKET / CHANNELS.len() / image.width).max(1);
        for (pixels, y) in image.pixels.chunks(rows * image.width).zip((window.y..).step_by(rows)) {
            viewer.send(PacketUpdateImage {
                image_name: &self.name,
                grab_focus: false,
                channel_names: &CHANNELS,
                channel_offsets: &[0, 1, 2],
                channel_strides: &[3, 3, 3],
                x: window.x,
                y,
                width: window.width,
                height: (pixels.len() / image.width) as u32,
                data: cast_slice(pixels),
            })?;
        }
        Ok(())
    }
}

/// A viewer that has answered and shows nothing of ours yet.
#[derive(Debug)]
pub struct Viewer {
    address: Address,
    socket: TcpStream,
}

impl Viewer {
    /// Calls the viewer at `address`.
    ///
    /// # Errors
    /// [`Error::Viewer`] where none answers.
    pub fn connect(address: &Address) -> Result<Self> {
        let fail = |source| Error::Viewer { address: address.to_string(), source };
        let mut last = io::Error::other("its name has no address");
        for place in (address.host.as_str(), address.port).to_socket_addrs().map_err(fail)? {
            match TcpStream::connect_timeout(&place, ANSWER) {
                Ok(socket) => return Ok(Self { address: address.clone(), socket }),
                Err(error) => last = error,
            }
        }
        Err(fail(last))
    }

    /// Opens a picture in the viewer.
    ///
    /// # Errors
    /// [`Error::Viewer`] where the system has no thread for it.
    pub fn open(self, mut canvas: Canvas) -> Result<LiveView> {
        let Self { address, socket } = self;
        // The protocol ends names with this character.
        canvas.name.retain(|c| c != '\0');
        let window = canvas.window();
        let news = Arc::new(News::default());
        let begin = || {
            socket.set_write_timeout(Some(STANDSTILL))?;
            let (client, news) = (TevClient::wrap(socket.try_clone()?), news.clone());
            Builder::new().name("live view".into()).spawn(move || news.end(send(client, &canvas, &news)))
        };
        let sender = begin().map_err(|source| Error::Viewer { address: address.to_string(), source })?;
        Ok(LiveView { address, size: [window.width, window.height], socket, news, sender: Some(sender) })
    }
}

/// A picture that a viewer shows.
#[derive(Debug)]
pub struct LiveView {
    address: Address,
    /// Columns and rows of the pictures.
    size: [u32; 2],
    socket: TcpStream,
    news: Arc<News>,
    sender: Option<JoinHandle<()>>,
}

impl LiveView {
    /// Shows these pixels, of any value, as soon as the viewer has taken those before; what it has not begun to take is left out.
    /// A picture without the canvas's columns and rows is not shown.
    pub fn show(&self, image: Image) {
        let [width, height] = self.size.map(|n| n as usize);
        if (image.width, image.height) == (width, height) && image.pixels.len() == width * height && width > 0 {
            self.news.tell(|state| state.newest = Some(image));
        }
    }

    /// Ends the connection once the viewer has taken the last picture, but waits no longer than `patience` for that. Returns what
    /// went wrong, if anything did.
    pub fn finish(mut self, patience: Duration) -> Option<String> {
        self.news.tell(|state| state.closing = true);
        let took_all = self.news.wait_for_end(patience);
        self.leave();
        let why = match self.news.lock().ended.take() {
            _ if !took_all => "it takes no data".to_owned(),
            Some(Ok(())) => return None,
            Some(Err(error)) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                "it takes no data".to_owned()
            }
            Some(Err(error)) => error.to_string(),
            None => "its thread failed".to_owned(),
        };
        Some(format!("the viewer at {} does not show the whole picture: {why}", self.address))
    }

    /// Ends the thread, whatever it is doing.
    fn leave(&mut self) {
        let Some(sender) = self.sender.take() else { return };
        self.news.tell(|state| (state.closing, state.newest) = (true, None));
        // Where the viewer has closed the connection already there is nothing left to end.
        let _ = self.socket.shutdown(Shutdown::Both);
        let _ = sender.join();
    }
}

impl Drop for LiveView {
    fn drop(&mut self) {
        self.leave();
    }
}

/// What there is to show, as the renderer tells the thread that sends it.
#[derive(Debug, Default)]
struct News {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// The newest picture, unless the viewer has it.
    newest: Option<Image>,
    /// Whether nothing newer will come.
    closing: bool,
    /// How sending ended; none while it goes on.
    ended: Option<io::Result<()>>,
}

impl News {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing is ever half done under the lock.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tell(&self, change: impl FnOnce(&mut State)) {
        let mut state = self.lock();
        change(&mut state);
        if state.ended.is_some() {
            state.newest = None;
        }
        self.changed.notify_all();
    }

    /// Waits for the next picture; none once there will be none.
    fn next(&self) -> Option<Image> {
        let nothing = |state: &mut State| state.newest.is_none() && !state.closing;
        let waited = self.changed.wait_while(self.lock(), nothing);
        waited.unwrap_or_else(PoisonError::into_inner).newest.take()
    }

    fn end(&self, result: io::Result<()>) {
        self.tell(|state| state.ended = Some(result));
    }

    /// Waits until sending has ended; returns whether it has.
    fn wait_for_end(&self, patience: Duration) -> bool {
        let goes_on = |state: &mut State| state.ended.is_none();
        let waited = self.changed.wait_timeout_while(self.lock(), patience, goes_on);
        waited.unwrap_or_else(PoisonError::into_inner).0.ended.is_some()
    }
}

/// Sends the canvas and then the newest picture, again and again.
fn send(mut viewer: TevClient, canvas: &Canvas, news: &News) -> io::Result<()> {
    canvas.create(&mut viewer)?;
    while let Some(image) = news.next() {
        canvas.update(&mut viewer, &image)?;
    }
    Ok(())
}
