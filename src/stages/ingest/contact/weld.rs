//! Points that lie near each other made one.

use std::collections::HashMap;

use glam::DVec2;

/// Points up to this many are compared with each other.
const FEW: usize = 24;

/// Points in order of their coordinates, each once.
#[must_use]
pub fn in_order(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    points
}

/// Number of a point among points in order.
#[must_use]
pub fn number_of(points: &[DVec2], p: DVec2) -> usize {
    let at = points.binary_search_by(|q| q.x.total_cmp(&p.x).then(q.y.total_cmp(&p.y)));
    at.expect("every end is there")
}

/// For each of some points in order, the first that stands for those within `near_m` of it: itself if there is none.
/// Visits all that stand for others and are as near, with the point's number.
pub fn weld(points: &[DVec2], near_m: f64, mut visit: impl FnMut(usize, usize)) -> Vec<u32> {
    let mut standing = Standing { points, near_m, cells: HashMap::new(), all: Vec::new() };
    let mut of = Vec::with_capacity(points.len());
    for i in 0..points.len() {
        let mut first = i;
        standing.near(i, |j| {
            first = first.min(j);
            visit(i, j);
        });
        if first == i {
            standing.add(i);
        }
        of.push(first as u32);
    }
    of
}

/// Points that stand for those near them: no two within reach of each other.
struct Standing<'a> {
    points: &'a [DVec2],
    near_m: f64,
    /// By cells so small that each holds at most one.
    cells: HashMap<[i64; 2], usize>,
    /// Where points are few.
    all: Vec<usize>,
}

impl Standing<'_> {
    fn cell(&self, i: usize) -> [i64; 2] {
        (self.points[i] / (0.7 * self.near_m)).floor().to_array().map(|x| x as i64)
    }

    fn near(&self, i: usize, mut visit: impl FnMut(usize)) {
        let mut look = |j: usize| {
            if self.points[i].distance_squared(self.points[j]) <= self.near_m * self.near_m {
                visit(j);
            }
        };
        if self.points.len() <= FEW {
            self.all.iter().for_each(|j| look(*j));
            return;
        }
        let [x, y] = self.cell(i);
        for dx in -2..=2 {
            for dy in -2..=2 {
                if let Some(j) = self.cells.get(&[x + dx, y + dy]) {
                    look(*j);
                }
            }
        }
    }

    fn add(&mut self, i: usize) {
        if self.points.len() <= FEW {
            self.all.push(i);
        } else {
            self.cells.insert(self.cell(i), i);
        }
    }
}

/// Sets that grow together.
pub struct Sets(Vec<u32>);

impl Sets {
    /// Of one each.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The least of a set, by any of it.
    pub fn of(&mut self, mut i: usize) -> usize {
        while self.0[i] as usize != i {
            self.0[i] = self.0[self.0[i] as usize];
            i = self.0[i] as usize;
        }
        i
    }

    /// Makes two sets one.
    pub fn unite(&mut self, a: usize, b: usize) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_find_what_comparing_all_finds() {
        let points =
            in_order((0..600).map(|i| DVec2::new(f64::from(i * 37 % 101), f64::from(i * 61 % 97)) * 0.002).collect());
        let near_m = 0.01;
        let mut standing: Vec<usize> = Vec::new();
        let expected: Vec<u32> = (0..points.len())
            .map(|i| {
                let near = standing.iter().copied().find(|j| points[i].distance(points[*j]) <= near_m);
                if near.is_none() {
                    standing.push(i);
                }
                near.unwrap_or(i) as u32
            })
            .collect();
        assert!(standing.len() < points.len() / 2);
        assert_eq!(weld(&points, near_m, |_, _| {}), expected);
    }
}
