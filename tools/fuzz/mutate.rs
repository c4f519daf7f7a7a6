//! From a corpus to broken inputs: bits, bytes, runs, words and numbers that readers tend to stumble over.

use super::targets::Target;

/// SplitMix64: an input follows from seed, target and number.
pub struct Random(u64);

impl Random {
    /// The numbers that make input `number` of a target.
    pub fn new(seed: u64, target: &str, number: u64) -> Self {
        let mix = |hash: u64, byte: u64| (hash ^ byte).wrapping_mul(0x0100_0000_01b3);
        let name = target.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| mix(hash, u64::from(byte)));
        let mut random = Self(name ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ number.rotate_left(32));
        random.next();
        random
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Below `end`, 0 if that is 0.
    fn below(&mut self, end: usize) -> usize {
        if end == 0 { 0 } else { (self.next() % end as u64) as usize }
    }

    fn pick<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }
}

/// Numbers at the edges of what fits.
const EDGES: [u64; 12] = [
    0,
    1,
    2,
    0x7f,
    0xff,
    0xffff,
    0x7fff_ffff,
    0xffff_ffff,
    0x1_0000_0000,
    0x7fff_ffff_ffff_ffff,
    0xffff_ffff_ffff_fff0,
    u64::MAX,
];

/// Bytes that mean something to one reader or other.
const BYTES: &[u8] = b"\0\x01\x7f\x80\xc3\xfe\xff\r\n\t \"'\\/#,;.-+eE0159{}";

/// Longest input, bytes.
const LONGEST: usize = 16 << 10;

/// One input: a member of the corpus after some mutations, rarely none.
pub fn input(target: &Target, random: &mut Random) -> Vec<u8> {
    let mut bytes = random.pick(&target.corpus).clone();
    for _ in 0..random.below(9) {
        mutate(target, &mut bytes, random);
        bytes.truncate(LONGEST);
    }
    if let Some(seal) = target.seal
        && random.below(4) > 0
    {
        seal(&mut bytes);
    }
    bytes
}

fn mutate(target: &Target, bytes: &mut Vec<u8>, random: &mut Random) {
    let at = random.below(bytes.len() + 1);
    let scale = random.below(7);
    let length = 1 + random.below(1 << scale);
    let end = (at + length).min(bytes.len());
    match random.below(11) {
        0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
        1 if at < bytes.len() => bytes[at] = *random.pick(BYTES),
        2 => bytes.insert(at, *random.pick(BYTES)),
        3 => drop(bytes.drain(at..end)),
        4 => {
            let copy = bytes[at..end].to_vec();
            let to = random.below(bytes.len() + 1);
            bytes.splice(to..to, copy);
        }
        5 => {
            let other = random.pick(&target.corpus);
            let from = random.below(other.len());
            let to = (from + length * 4).min(other.len());
            bytes.splice(at..at, other[from..to].iter().copied());
        }
        6 | 7 if !target.words.is_empty() => {
            let word = random.pick(target.words).as_bytes();
            let replaced = if random.below(2) == 0 { at..at } else { at..end };
            bytes.splice(replaced, word.iter().copied());
        }
        6..=8 if bytes.len() >= 8 => {
            // Numbers of records lie at multiples of their size.
            let width = [1, 2, 4, 8][random.below(4)];
            let at = random.below(bytes.len() / width) * width;
            let near = (random.next() % 64).wrapping_sub(16);
            let less = random.next() & 1;
            let number = if random.below(3) == 0 { near } else { random.pick(&EDGES).wrapping_sub(less) };
            bytes[at..at + width].copy_from_slice(&number.to_le_bytes()[..width]);
        }
        9 => bytes.truncate(at),
        _ => {
            let noise: Vec<u8> = (0..length).map(|_| random.next() as u8).collect();
            bytes.splice(at..end, noise);
        }
    }
}
