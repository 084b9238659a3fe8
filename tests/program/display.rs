//! `fanal render --display`: what a viewer receives, by the protocol as tev documents it, and what becomes of the render without one.

use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{JoinHandle, spawn};
use std::time::{Duration, Instant};

use fanal::cli::interrupt::EXIT_EARLY;
use fanal::picture::read_image;

/// Longer than anything here takes on the slowest machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// Bytes of a packet that have not been read yet.
struct Packet<'a>(&'a [u8]);

impl Packet<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (head, rest) = self.0.split_first_chunk::<N>().expect("the packet goes on");
        self.0 = rest;
        *head
    }

    fn int(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }

    fn long(&mut self) -> i64 {
        i64::from_le_bytes(self.bytes())
    }

    fn flag(&mut self) -> bool {
        let [flag] = self.bytes();
        assert!(flag < 2);
        flag == 1
    }

    /// Text up to a byte of 0.
    fn text(&mut self) -> String {
        let end = self.0.iter().position(|&b| b == 0).expect("a text ends");
        let text = String::from_utf8(self.0[..end].to_vec()).expect("it is UTF-8");
        self.0 = &self.0[end + 1..];
        text
    }
}

/// A picture as a viewer holds it.
#[derive(Debug, Default, PartialEq)]
struct Shown {
    name: String,
    size: [usize; 2],
    /// Bits of R, G and B.
    pixels: Vec<[u32; 3]>,
    /// Updates of each pixel.
    updates: Vec<u32>,
}

impl Shown {
    /// Does what one packet says, and reads every byte of it.
    fn take(&mut self, packet: &[u8]) {
        let mut packet = Packet(packet);
        let [operation] = packet.bytes();
        let focus = packet.flag();
        let name = packet.text();
        match operation {
            // CreateImage: focus, name, columns, rows, number of channels, their names.
            4 => {
                assert!(focus && self.name.is_empty(), "the picture is made once, to be looked at");
                let [width, height] = [packet.int() as usize, packet.int() as usize];
                (self.name, self.size) = (name, [width, height]);
                self.pixels = vec![[0; 3]; width * height];
                self.updates = vec![0; width * height];
                assert_eq!(packet.int(), 3);
            }
            // UpdateImage, third version: focus, name, number of channels, their names, window, offset and stride of each, numbers.
            6 => {
                assert!(!focus && name == self.name);
                assert_eq!(packet.int(), 3);
            }
            other => panic!("there is no use for operation {other}"),
        }
        assert_eq!([packet.text(), packet.text(), packet.text()], ["R", "G", "B"]);
        if operation == 6 {
            self.update(&mut packet);
        }
        assert!(packet.0.is_empty(), "{} bytes too many", packet.0.len());
    }

    fn update(&mut self, packet: &mut Packet) {
        let [x, y, width, height] = [(); 4].map(|()| packet.int() as usize);
        assert!(x + width <= self.size[0] && y + height <= self.size[1] && width * height > 0);
        let (offsets, strides) = ([(); 3].map(|()| packet.long() as usize), [(); 3].map(|()| packet.long() as usize));
        let numbers: Vec<u32> =
            packet.0.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        for index in 0..width * height {
            let at = (y + index / width) * self.size[0] + x + index % width;
            self.pixels[at] = [0, 1, 2].map(|c| numbers[offsets[c] + index * strides[c]]);
            self.updates[at] += 1;
        }
        packet.0 = &packet.0[numbers.len() * 4..];
    }
}

/// A viewer that waits for one render.
struct Viewer {
    address: String,
    /// Whole pictures so far.
    pictures: Arc<AtomicUsize>,
    shown: JoinHandle<Shown>,
}

impl Viewer {
    fn begin() -> Self {
        let (address, listener) = listener();
        let pictures = Arc::new(AtomicUsize::new(0));
        let counted = pictures.clone();
        let shown = spawn(move || {
            let (mut socket, _) = listener.accept().unwrap();
            let mut shown = Shown::default();
            while let Some(length) = length(&mut socket) {
                let mut packet = vec![0; length - 4];
                socket.read_exact(&mut packet).expect("a packet is as long as it says");
                shown.take(&packet);
                let whole = shown.updates.iter().copied().max().unwrap_or(0);
                counted.store(whole as usize, Ordering::Relaxed);
            }
            shown
        });
        Self { address, pictures, shown }
    }

    fn shown(self) -> Shown {
        self.shown.join().expect("the viewer understands everything")
    }
}

/// The next packet's length, its own four bytes included; none at the end.
fn length(socket: &mut TcpStream) -> Option<usize> {
    let mut length = [0; 4];
    match socket.read(&mut length[..1]).unwrap() {
        0 => None,
        _ => {
            socket.read_exact(&mut length[1..]).unwrap();
            Some(u32::from_le_bytes(length) as usize)
        }
    }
}

fn listener() -> (String, TcpListener) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    (listener.local_addr().unwrap().to_string(), listener)
}

fn start(address: &str, output: &Path, options: &[&str]) -> Child {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell");
    let mut command = Command::new(env!("CARGO_BIN_EXE_fanal"));
    command.arg("render").arg(scene).arg("-o").arg(output).args(["--guide", "none", "--display", address]);
    command.args(options).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it can be started")
}

/// Renders to the end, which must be a good one, and returns the warnings.
fn render(address: &str, output: &Path, options: &[&str]) -> String {
    told(start(address, output, options).wait_with_output().unwrap(), 0)
}

fn told(output: Output, code: i32) -> String {
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{told}");
    assert!(!told.contains("panicked"), "{told}");
    told
}

/// Bits of the pixels of a written picture.
fn written(path: &Path) -> Vec<[u32; 3]> {
    let image = read_image(path, false).expect("it was written");
    image.pixels.iter().map(|pixel| pixel.to_array().map(f32::to_bits)).collect()
}

#[test]
fn a_viewer_gets_the_picture_that_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("lantern.exr");
    let viewer = Viewer::begin();
    let told = render(&viewer.address, &output, &["--size", "40x30", "--spp", "16"]);
    assert!(!told.contains("warning"), "{told}");
    let shown = viewer.shown();
    assert_eq!((shown.name.as_str(), shown.size), (&*output.display().to_string(), [40, 30]));
    assert!(shown.updates.iter().all(|&n| n > 0));
    assert!(shown.pixels == written(&output));
}

/// Rows of 700 pixels do not fit a packet evenly. A window is shown in its place, the rest stays black.
#[test]
fn windows_are_shown_in_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("part.exr");
    let viewer = Viewer::begin();
    render(&viewer.address, &output, &["--size", "800x600", "--crop", "60,50,700,301", "--spp", "1"]);
    let shown = viewer.shown();
    assert_eq!(shown.size, [800, 600]);
    let part = written(&output);
    for (index, (pixel, updates)) in shown.pixels.iter().zip(&shown.updates).enumerate() {
        let (column, row) = (index % 800, index / 800);
        let inside = (60..760).contains(&column) && (50..351).contains(&row);
        let expected = if inside { part[(row - 50) * 700 + column - 60] } else { [0; 3] };
        assert_eq!((*pixel, *updates > 0), (expected, inside), "{column}, {row}");
    }
}

/// The viewer sees pictures come, and at last the one that an interrupted render leaves.
#[cfg(unix)]
#[test]
fn pictures_come_while_rendering() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.exr");
    let viewer = Viewer::begin();
    let mut child = start(&viewer.address, &output, &["--size", "16x12", "--spp", "16000000"]);
    let begun = Instant::now();
    while viewer.pictures.load(Ordering::Relaxed) < 3 {
        assert!(begun.elapsed() < PATIENCE && child.try_wait().unwrap().is_none(), "no three pictures come");
        std::thread::sleep(Duration::from_millis(10));
    }
    let kill = format!("kill -TERM {}", child.id());
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
    told(child.wait_with_output().unwrap(), i32::from(EXIT_EARLY));
    assert!(viewer.shown().pixels == written(&output));
}

/// A viewer that takes nothing, and one that is closed: the picture, of 12 MB, is what it is without them, with a warning. Sockets hold
/// less than that of what nobody reads.
#[test]
fn a_viewer_that_fails_is_no_failure() {
    let folder = tempfile::tempdir().unwrap();
    let options = ["--size", "1024x1024", "--spp", "1", "--max-depth", "2"];
    let pictures = [false, true].map(|closes| {
        let output = folder.path().join(format!("{closes}.exr"));
        let (address, listener) = listener();
        let viewer = spawn(move || listener.accept().map(|(socket, _)| (!closes).then_some(socket)).unwrap());
        let told = render(&address, &output, &options);
        drop(viewer.join().unwrap());
        assert!(told.contains(&format!("warning: the viewer at {address} does not show")), "{told}");
        written(&output)
    });
    let viewer = Viewer::begin();
    let output = folder.path().join("whole.exr");
    render(&viewer.address, &output, &options);
    assert!(pictures.iter().all(|picture| *picture == written(&output)));
    assert!(viewer.shown().pixels == written(&output));
}

/// Nothing is rendered where no viewer is, and the message says what to do.
#[test]
fn a_missing_viewer_is_told_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.exr");
    let address = listener().0;
    let message = told(start(&address, &output, &[]).wait_with_output().unwrap(), 1);
    for word in [&*address, "tev", "HDRView", "--display"] {
        assert!(message.contains(word), "{message}");
    }
    for wrong in ["localhost:99999", ":14158", "::1"] {
        let message = told(start(wrong, &output, &[]).wait_with_output().unwrap(), 2);
        assert!(message.contains("--display") && message.contains("HOST:PORT"), "{message}");
    }
    assert!(!output.exists());
}
