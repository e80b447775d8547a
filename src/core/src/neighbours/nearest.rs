//! The k nearest of what is offered.

/// A point and its squared distance in one number: the bits of a distance ≥ 0 rise with it, below them is the index. So
/// one comparison orders by distance, and of equal distances the lowest index comes first.
pub(crate) fn pack(squared: f32, index: u32) -> u64 {
    u64::from(squared.to_bits()) << 32 | u64::from(index)
}

/// What [`pack`] put together.
pub(crate) fn unpack(key: u64) -> (u32, f32) {
    (key as u32, f32::from_bits((key >> 32) as u32))
}

/// The nearest of the points offered, nearest first, of equal distances the lowest index first. Kept from query to query
/// it allocates once.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    wanted: usize,
    keys: Vec<u64>,
}

impl Neighbours {
    /// Room for `k` neighbours.
    pub fn with_capacity(k: usize) -> Self {
        Self { wanted: k, keys: Vec::with_capacity(k) }
    }

    /// How many were found: the k asked for, or as many as there are.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Whether none was found.
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// (index, squared distance in m²), nearest first.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (u32, f32)> + '_ {
        self.keys.iter().map(|&key| unpack(key))
    }

    /// The n-th nearest, from 0.
    pub fn get(&self, n: usize) -> Option<(u32, f32)> {
        self.keys.get(n).map(|&key| unpack(key))
    }

    /// Forgets what was found and asks for the `k` nearest from now on.
    pub(crate) fn ask(&mut self, k: usize) {
        self.wanted = k;
        self.keys.clear();
        self.keys.reserve(k);
    }

    /// The squared distance beyond which nothing is wanted any more.
    pub(crate) fn reach(&self) -> f32 {
        match self.keys.last() {
            Some(&last) if self.keys.len() >= self.wanted => unpack(last).1,
            _ if self.wanted == 0 => f32::NEG_INFINITY,
            _ => f32::INFINITY,
        }
    }

    /// Takes a point if it is among the nearest so far.
    pub(crate) fn offer(&mut self, squared: f32, index: u32) {
        let key = pack(squared, index);
        if self.keys.len() >= self.wanted {
            match self.keys.last_mut() {
                Some(last) if key < *last => *last = key,
                _ => return,
            }
        } else {
            self.keys.push(key);
        }
        // The list is sorted but for its last entry: let it sink to its place.
        let mut rest = self.keys.as_mut_slice();
        while let [.., before, last] = rest {
            if *before <= *last {
                break;
            }
            core::mem::swap(before, last);
            let shorter = rest.len() - 1;
            rest = rest.split_at_mut(shorter).0;
        }
    }
}
