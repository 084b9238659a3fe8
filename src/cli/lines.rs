//! Progress where there is no terminal: a line on stderr from time to time, for logs.

use std::io::Write;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::base::Progress;

/// Least time between two lines, and before the first.
pub const INTERVAL: Duration = Duration::from_secs(10);
/// Time between two looks at whether a line is due.
const LOOK: Duration = Duration::from_millis(250);

/// Progress lines on stderr as long as this value lives, also while the work reports nothing.
pub struct Lines {
    log: Arc<Log>,
    /// Channel that closes when this value is dropped, which ends the thread that looks.
    _lives: Sender<()>,
}

impl Lines {
    /// Starts the clock, and the thread that writes a line whenever one is due.
    pub fn begin() -> Self {
        let begun = Instant::now();
        let log = Arc::new(Log::new(Box::new(move || begun.elapsed()), Box::new(std::io::stderr())));
        let (lives, ended) = channel();
        let watched = Arc::clone(&log);
        let look = move || {
            while ended.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
                watched.look();
            }
        };
        // Without a thread for it there is no progress to see, which is no reason not to work.
        let _ = thread::Builder::new().name("progress".into()).spawn(look);
        Self { log, _lives: lives }
    }
}

impl Progress for Lines {
    fn start(&self, total: u64, unit: &str) {
        self.log.start(total, unit);
    }

    fn advance(&self, n: u64) {
        self.log.advance(n);
    }

    fn message(&self, text: &str) {
        self.log.message(text);
    }

    fn reached(&self, part: Option<f64>, what: &str) {
        self.log.reached(part, what);
    }

    fn finish(&self) {
        self.log.finish();
    }
}

/// Time since some moment.
type Clock = Box<dyn Fn() -> Duration + Send + Sync>;

/// State of [`Lines`], with a clock and an output that tests can replace.
struct Log {
    clock: Clock,
    state: Mutex<State>,
    out: Mutex<Box<dyn Write + Send>>,
}

#[derive(Default)]
struct State {
    /// Whether work has begun that has not ended.
    works: bool,
    begun: Duration,
    told: Duration,
    done: u64,
    total: u64,
    unit: String,
    message: String,
    part: Option<f64>,
    what: String,
}

impl Log {
    fn new(clock: Clock, out: Box<dyn Write + Send>) -> Self {
        Self { clock, state: Mutex::default(), out: Mutex::new(out) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Whatever a thread left there when it panicked can be told.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes a line if it is time.
    fn look(&self) {
        let now = (self.clock)();
        let mut state = self.state();
        if !state.works || now.saturating_sub(state.told) < INTERVAL {
            return;
        }
        state.told = now;
        let line = state.line(now);
        drop(state);
        // With stderr closed there is nobody left to tell.
        let _ = self.out.lock().unwrap_or_else(PoisonError::into_inner).write_all(line.as_bytes());
    }
}

/// A part of the work as text, rounded down: all is not done before it is.
pub fn percent(part: f64) -> String {
    format!("{:.0} %", (100.0 * part.clamp(0.0, 1.0)).floor())
}

impl State {
    /// One line: message, percentage done, status or count of units, seconds since the work began.
    fn line(&self, now: Duration) -> String {
        let counted = (self.total > 0).then(|| self.done as f64 / self.total as f64);
        let part = self.part.or(counted).map(percent);
        let count = || match self.total {
            0 => format!("{} {}", self.done, self.unit),
            total => format!("{} of {total} {}", self.done, self.unit),
        };
        let what = if self.what.is_empty() { count() } else { self.what.clone() };
        let seconds = format!("{} s", now.saturating_sub(self.begun).as_secs());
        let doing = Some(&self.message).filter(|message| !message.is_empty());
        let doing = doing.map_or(String::new(), |message| format!("{message}: "));
        let parts: Vec<String> = part.into_iter().chain([what, seconds]).collect();
        format!("fanal: {doing}{}\n", parts.join(", "))
    }
}

impl Progress for Log {
    fn start(&self, total: u64, unit: &str) {
        let now = (self.clock)();
        *self.state() = State { works: true, begun: now, told: now, total, unit: unit.to_owned(), ..State::default() };
    }

    fn advance(&self, n: u64) {
        self.state().done += n;
    }

    fn message(&self, text: &str) {
        text.clone_into(&mut self.state().message);
    }

    fn reached(&self, part: Option<f64>, what: &str) {
        let mut state = self.state();
        state.part = part;
        what.clone_into(&mut state.what);
    }

    fn finish(&self) {
        self.state().works = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[derive(Clone, Default)]
    struct Shared(Arc<Mutex<Vec<u8>>>);

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    /// A log with a clock in milliseconds that is set by hand.
    struct Bench {
        log: Log,
        now: Arc<AtomicU64>,
        out: Shared,
    }

    impl Bench {
        fn new() -> Self {
            let (now, out) = (Arc::new(AtomicU64::new(5_000)), Shared::default());
            let clock = Arc::clone(&now);
            let clock = Box::new(move || Duration::from_millis(clock.load(Ordering::Relaxed)));
            Self { log: Log::new(clock, Box::new(out.clone())), now, out }
        }

        /// Output of looking every quarter of a second until `end`, in milliseconds.
        fn until(&self, end: u64) -> String {
            while self.now.load(Ordering::Relaxed) < end {
                self.now.fetch_add(250, Ordering::Relaxed);
                self.log.look();
            }
            String::from_utf8(std::mem::take(&mut *self.out.0.lock().unwrap())).unwrap()
        }
    }

    #[test]
    fn a_line_every_ten_seconds_while_there_is_work() {
        let bench = Bench::new();
        assert_eq!(bench.until(40_000), "", "nothing has begun");
        bench.log.start(400, "samples");
        bench.log.message("learning, iteration 3");
        bench.log.advance(100);
        assert_eq!(bench.until(49_750), "");
        assert_eq!(bench.until(50_000), "fanal: learning, iteration 3: 25 %, 100 of 400 samples, 10 s\n");
        bench.log.advance(299);
        bench.log.reached(None, "17 spp");
        assert_eq!(bench.until(59_750), "");
        assert_eq!(bench.until(60_000), "fanal: learning, iteration 3: 99 %, 17 spp, 20 s\n");
        assert_eq!(bench.until(160_000).lines().count(), 10);
        bench.log.finish();
        assert_eq!(bench.until(260_000), "", "it is over");
    }

    /// The part is that of the time where the work ends by it, and is left out where nobody knows it.
    #[test]
    fn parts_may_be_unknown() {
        let bench = Bench::new();
        bench.log.start(0, "samples");
        bench.log.advance(7);
        assert_eq!(bench.until(15_000), "fanal: 7 samples, 10 s\n");
        bench.log.reached(Some(0.42), "3 spp, relMSE 1.000e-2");
        assert_eq!(bench.until(25_000), "fanal: 42 %, 3 spp, relMSE 1.000e-2, 20 s\n");
        bench.log.start(3, "runs");
        assert_eq!(bench.until(35_000), "fanal: 0 %, 0 of 3 runs, 10 s\n");
    }
}
