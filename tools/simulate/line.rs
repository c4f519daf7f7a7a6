//! What moving data takes: one master between the workers and the store.

use super::args::Master;

/// What a download or upload costs.
#[derive(Clone, Copy)]
pub struct Costs {
    /// Bytes a second, in each direction; `None` if moving them takes no time.
    pub bandwidth: Option<u64>,
    /// Before the first byte arrives, s.
    pub latency_s: f64,
}

impl Costs {
    /// Latency and time of moving, s. Nothing to move takes nothing.
    fn of(self, bytes: u64) -> (f64, f64) {
        let moving_s = self.bandwidth.map_or(0.0, |per_s| bytes as f64 / per_s as f64);
        if bytes == 0 { (0.0, 0.0) } else { (self.latency_s, moving_s) }
    }
}

/// What became of a worker's time between two tasks, s.
#[derive(Clone, Copy, Default)]
pub struct Exchange {
    /// For others.
    pub waiting_s: f64,
    /// For first bytes.
    pub latency_s: f64,
    /// For bytes.
    pub moving_s: f64,
    /// When the download begins, its latency included.
    pub download_begin_s: f64,
    /// When the worker goes on.
    pub free_s: f64,
    /// When its update is in.
    pub delivered_s: f64,
}

/// The master's line.
pub struct Line {
    master: Master,
    costs: Costs,
    /// When each direction, up and down, is free; one for both of a synchronous master.
    free_s: [f64; 2],
    /// For how long each has been busy, s.
    busy_s: [f64; 2],
}

impl Line {
    /// A free line.
    pub fn new(master: Master, costs: Costs) -> Self {
        Self { master, costs, free_s: [0.0; 2], busy_s: [0.0; 2] }
    }

    /// For how long the busier direction has been busy, s.
    pub fn busy_s(&self) -> f64 {
        self.busy_s[0].max(self.busy_s[1])
    }

    /// Serves a worker that is ready: takes an update of `up` bytes, sends `down` bytes for the next task. Those who are
    /// ready first are served first: `ready_s` never falls from one call to the next.
    pub fn exchange(&mut self, ready_s: f64, up: Option<u64>, down: Option<u64>) -> Exchange {
        if up.is_none() && down.is_none() {
            return Exchange {
                download_begin_s: ready_s,
                free_s: ready_s,
                delivered_s: ready_s,
                ..Exchange::default()
            };
        }
        match self.master {
            Master::Sync => self.one_at_a_time(ready_s, [up, down]),
            Master::Async => {
                let sent = up.map(|bytes| self.pass(0, ready_s, bytes));
                let received = down.map(|bytes| self.pass(1, ready_s, bytes));
                let delivered_s = sent.map_or(ready_s, |sent| sent.free_s);
                // Who has something to do does not wait for its update.
                Exchange { delivered_s, ..received.or(sent).expect("one of them") }
            }
        }
    }

    fn one_at_a_time(&mut self, ready_s: f64, transfers: [Option<u64>; 2]) -> Exchange {
        let start_s = ready_s.max(self.free_s[0]);
        let (mut latency_s, mut moving_s) = (0.0, 0.0);
        let mut download_begin_s = start_s;
        for bytes in transfers.into_iter().flatten() {
            let (latency, moving) = self.costs.of(bytes);
            // The download is the last.
            download_begin_s = start_s + latency_s + moving_s;
            latency_s += latency;
            moving_s += moving;
        }
        let free_s = start_s + latency_s + moving_s;
        self.free_s[0] = free_s;
        self.busy_s[0] += latency_s + moving_s;
        let waiting_s = start_s - ready_s;
        Exchange { waiting_s, latency_s, moving_s, download_begin_s, free_s, delivered_s: free_s }
    }

    /// Only bytes take their turn: latencies of several workers pass at the same time.
    fn pass(&mut self, direction: usize, ready_s: f64, bytes: u64) -> Exchange {
        let (latency_s, moving_s) = self.costs.of(bytes);
        let arrives_s = ready_s + latency_s;
        let start_s = if moving_s > 0.0 { arrives_s.max(self.free_s[direction]) } else { arrives_s };
        let free_s = start_s + moving_s;
        self.free_s[direction] = self.free_s[direction].max(free_s);
        self.busy_s[direction] += moving_s;
        let waiting_s = start_s - arrives_s;
        Exchange { waiting_s, latency_s, moving_s, download_begin_s: ready_s, free_s, delivered_s: free_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COSTS: Costs = Costs { bandwidth: Some(100), latency_s: 0.5 };

    #[test]
    fn a_synchronous_master_serves_one_at_a_time_and_an_asynchronous_one_lets_latencies_pass_together() {
        let mut line = Line::new(Master::Sync, COSTS);
        assert_eq!(line.exchange(1.0, None, Some(200)).free_s, 3.5);
        let second = line.exchange(1.0, Some(100), Some(100));
        assert_eq!((second.waiting_s, second.latency_s, second.moving_s, second.free_s), (2.5, 1.0, 2.0, 6.5));
        assert_eq!(second.download_begin_s, 5.0, "after the upload");
        assert_eq!(line.busy_s(), 5.5);

        let mut line = Line::new(Master::Async, COSTS);
        assert_eq!(line.exchange(1.0, None, Some(200)).free_s, 3.5);
        let second = line.exchange(1.0, Some(100), Some(100));
        assert_eq!((second.waiting_s, second.latency_s, second.moving_s), (2.0, 0.5, 1.0), "both latencies at once");
        assert_eq!((second.free_s, second.delivered_s), (4.5, 2.5), "up and down pass each other");
        assert_eq!(second.download_begin_s, 1.0, "beside the upload");
        assert_eq!(line.busy_s(), 3.0);
    }

    #[test]
    fn nothing_to_move_takes_no_time() {
        for master in [Master::Sync, Master::Async] {
            let mut line = Line::new(master, COSTS);
            assert_eq!(line.exchange(1.0, None, Some(0)).free_s, 1.0);
            let mut line = Line::new(master, Costs { bandwidth: None, latency_s: 0.0 });
            assert_eq!(line.exchange(1.0, Some(1 << 40), Some(1 << 40)).free_s, 1.0);
            assert_eq!(line.busy_s(), 0.0);
        }
    }
}
