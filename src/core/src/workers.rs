//! The threads that share the core's heavy loops. They change when a result is there, never what it is.

use rayon::prelude::*;
use std::sync::Arc;

/// Items of one piece of work. Fixed, so that the pieces are the same for any number of threads.
const PIECE: usize = 8_192;

/// The core's threads: none, or a pool that the shell gives it.
#[derive(Clone, Debug, Default)]
pub struct Workers {
    pool: Option<Arc<rayon::ThreadPool>>,
}

impl Workers {
    /// No threads but the caller's.
    pub fn none() -> Self {
        Self::default()
    }

    /// The threads of a pool.
    pub fn pool(pool: Arc<rayon::ThreadPool>) -> Self {
        Self { pool: Some(pool) }
    }

    /// What `work` answers to each item, in the items' order.
    pub(crate) fn map<T: Sync, R: Send>(&self, items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
        match &self.pool {
            Some(pool) => pool.install(|| items.par_iter().map(&work).collect()),
            None => items.iter().map(work).collect(),
        }
    }

    /// Calls `work` with each piece of the columns: three to read and four to write, all of the same length.
    pub(crate) fn map_columns(
        &self,
        from: [&[f32]; 3],
        to: [&mut [f32]; 3],
        flags: &mut [bool],
        work: impl Fn([&[f32]; 3], [&mut [f32]; 3], &mut [bool]) + Sync,
    ) {
        let [x, y, z] = from;
        let [to_x, to_y, to_z] = to;
        let Some(pool) = self.pool.as_ref().filter(|_| x.len() > PIECE) else {
            return work([x, y, z], [to_x, to_y, to_z], flags);
        };
        pool.install(|| {
            let read = x.par_chunks(PIECE).zip(y.par_chunks(PIECE)).zip(z.par_chunks(PIECE));
            let write = to_x.par_chunks_mut(PIECE).zip(to_y.par_chunks_mut(PIECE)).zip(to_z.par_chunks_mut(PIECE));
            read.zip(write).zip(flags.par_chunks_mut(PIECE)).for_each(
                |((((x, y), z), ((to_x, to_y), to_z)), flags)| {
                    work([x, y, z], [to_x, to_y, to_z], flags);
                },
            );
        });
    }
}
