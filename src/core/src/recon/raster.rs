//! Where a plane has points: cells of it, closed over small gaps, and the outlines of what they cover.

use nalgebra::Point2;
use std::collections::VecDeque;

/// Cells of a raster at most: of a larger plane the cells are larger.
const MOST_CELLS: usize = 1 << 20;
/// Two and a half cells around one.
const DISC: [(i64, i64); 21] = [
    (-2, -1),
    (-2, 0),
    (-2, 1),
    (-1, -2),
    (-1, -1),
    (-1, 0),
    (-1, 1),
    (-1, 2),
    (0, -2),
    (0, -1),
    (0, 0),
    (0, 1),
    (0, 2),
    (1, -2),
    (1, -1),
    (1, 0),
    (1, 1),
    (1, 2),
    (2, -1),
    (2, 0),
    (2, 1),
];
/// A patch of fewer cells has no outline.
const LEAST_CELLS: usize = 9;

/// Occupied cells of a plane, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Raster {
    low: [f64; 2],
    cell_m: f64,
    columns: i64,
    rows: i64,
    cells: Vec<bool>,
}

/// The four steps from a corner of a cell to the next, anticlockwise: right, up, left, down.
const STEPS: [(i64, i64); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];

impl Raster {
    /// Of places in a plane; cells of at least `cell_m`, m. Gaps of up to some four cells are closed.
    pub(super) fn of(places: &[Point2<f64>], cell_m: f64) -> Self {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for place in places {
            low = [low[0].min(place.x), low[1].min(place.y)];
            high = [high[0].max(place.x), high[1].max(place.y)];
        }
        let extents = [high[0] - low[0], high[1] - low[1]];
        if !extents.iter().all(|extent| extent.is_finite()) || cell_m.is_nan() || cell_m <= 0.0 {
            return Self::default();
        }
        let fitting = libm::sqrt(extents[0] * extents[1] / MOST_CELLS as f64).max(extents[0].max(extents[1]) / 1e5);
        let cell_m = cell_m.max(2.0 * fitting);
        // Four cells of margin: closing looks two away and must not meet the end.
        let low = low.map(|low| low - 4.0 * cell_m);
        let count = |extent: f64| (extent / cell_m) as i64 + 9;
        let (columns, rows) = (count(extents[0]), count(extents[1]));
        let mut raster = Self { low, cell_m, columns, rows, cells: vec![false; (columns * rows) as usize] };
        for place in places {
            let (column, row) = raster.cell_of(place);
            raster.set(column, row);
        }
        raster.close();
        raster
    }

    fn cell_of(&self, place: &Point2<f64>) -> (i64, i64) {
        if self.cells.is_empty() {
            return (-1, -1);
        }
        let at = |c: f64, low: f64| libm::floor((c - low) / self.cell_m).clamp(-2.0, 1e9) as i64;
        (at(place.x, self.low[0]), at(place.y, self.low[1]))
    }

    fn place(&self, column: i64, row: i64) -> Option<usize> {
        let inside = (0..self.columns).contains(&column) && (0..self.rows).contains(&row);
        inside.then(|| (row * self.columns + column) as usize)
    }

    fn has(&self, column: i64, row: i64) -> bool {
        self.place(column, row).and_then(|at| self.cells.get(at)).copied().unwrap_or(false)
    }

    fn set(&mut self, column: i64, row: i64) {
        if let Some(cell) = self.place(column, row).and_then(|at| self.cells.get_mut(at)) {
            *cell = true;
        }
    }

    /// Fills gaps that a disc of two and a half cells does not fit into: grown by the disc, then shrunk by it.
    fn close(&mut self) {
        let grown = self.swept(true);
        *self = grown.swept(false);
    }

    /// Cells with a cell within the disc that is `occupied`, if so; cells with none within it that is not, otherwise.
    fn swept(&self, occupied: bool) -> Self {
        let mut swept = self.clone();
        let mut cells = swept.cells.iter_mut();
        for row in 0..self.rows {
            for column in 0..self.columns {
                let Some(cell) = cells.next() else { return swept };
                let meets = DISC.iter().any(|(dx, dy)| self.has(column + dx, row + dy) == occupied);
                *cell = meets == occupied;
            }
        }
        swept
    }

    /// The edge of a cell, m.
    pub(super) fn cell_m(&self) -> f64 {
        self.cell_m
    }

    /// How many cells are occupied.
    pub(super) fn occupied(&self) -> usize {
        self.cells.iter().filter(|cell| **cell).count()
    }

    /// Whether a place is within so many cells of an occupied one.
    pub(super) fn is_near(&self, place: &Point2<f64>, reach: i64) -> bool {
        let (column, row) = self.cell_of(place);
        (-reach..=reach).any(|dy| (-reach..=reach).any(|dx| self.has(column + dx, row + dy)))
    }

    /// The outer outline of every patch of nine cells or more, anticlockwise, corners at cells' corners.
    pub(super) fn outlines(&self) -> Vec<Vec<Point2<f64>>> {
        let mut patch = vec![0u32; self.cells.len()];
        let mut outlines = Vec::new();
        let mut number = 0;
        for row in 0..self.rows {
            for column in 0..self.columns {
                let Some(at) = self.place(column, row) else { continue };
                if !self.has(column, row) || patch.get(at).is_some_and(|patch| *patch != 0) {
                    continue;
                }
                number += 1;
                // The first cell met of a patch is in its lowest row: below it there is nothing of the patch.
                if self.flood((column, row), number, &mut patch) >= LEAST_CELLS {
                    outlines.push(self.around((column, row), number, &patch));
                }
            }
        }
        outlines
    }

    /// Marks all cells of a patch, joined by their sides; returns how many.
    fn flood(&self, from: (i64, i64), number: u32, patch: &mut [u32]) -> usize {
        let mut waiting = VecDeque::from([from]);
        let mut count = 0;
        while let Some((column, row)) = waiting.pop_front() {
            let Some(mark) = self.place(column, row).and_then(|at| patch.get_mut(at)) else { continue };
            if *mark != 0 || !self.has(column, row) {
                continue;
            }
            *mark = number;
            count += 1;
            waiting.extend(STEPS.map(|(dx, dy)| (column + dx, row + dy)));
        }
        count
    }

    /// Goes along the cells' sides with the patch on the left, from the lower left corner of its first cell.
    fn around(&self, (column, row): (i64, i64), number: u32, patch: &[u32]) -> Vec<Point2<f64>> {
        let is_of = |column: i64, row: i64| {
            self.place(column, row).and_then(|at| patch.get(at)).is_some_and(|patch| *patch == number)
        };
        // The cells ahead of a corner, left and right of each direction.
        let ahead = |(x, y): (i64, i64), direction: usize| match direction {
            0 => [(x, y), (x, y - 1)],
            1 => [(x - 1, y), (x, y)],
            2 => [(x - 1, y - 1), (x - 1, y)],
            _ => [(x, y - 1), (x - 1, y - 1)],
        };
        let mut corners = Vec::new();
        let (mut at, mut direction) = ((column, row), 0);
        // Every side of every cell once at most.
        for _ in 0..4 * self.cells.len() {
            let (dx, dy) = STEPS.get(direction).copied().unwrap_or_default();
            at = (at.0 + dx, at.1 + dy);
            // Cells that touch at a corner only are not joined.
            let turn = match ahead(at, direction).map(|(x, y)| is_of(x, y)) {
                [false, _] => 1,
                [true, false] => 0,
                [true, true] => 3,
            };
            if turn != 0 {
                let [x, y] = [at.0 as f64, at.1 as f64].map(|c| c * self.cell_m);
                corners.push(Point2::new(self.low[0] + x, self.low[1] + y));
                direction = (direction + turn) % STEPS.len();
            }
            if at == (column, row) && direction == 0 {
                break;
            }
        }
        corners
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(columns: i64, rows: i64) -> Vec<Point2<f64>> {
        (0..rows)
            .flat_map(|row| (0..columns).map(move |column| Point2::new(column as f64 + 0.5, row as f64 + 0.5)))
            .collect()
    }

    fn area(outline: &[Point2<f64>]) -> f64 {
        let next = outline.iter().cycle().skip(1);
        outline.iter().zip(next).map(|(a, b)| 0.5 * (a.x * b.y - b.x * a.y)).sum()
    }

    #[test]
    fn a_rectangles_outline_has_its_area() {
        // 7 × 4 cells of 1 m.
        let outlines = Raster::of(&grid(7, 4), 1.0).outlines();
        assert_eq!(outlines.len(), 1);
        assert!((area(&outlines[0]) - 28.0).abs() < 1e-9, "{:?}", outlines[0]);
    }

    #[test]
    fn an_l_has_the_area_of_its_cells_and_two_patches_two_outlines() {
        let mut places = grid(9, 3);
        places.extend(grid(3, 9));
        // 27 + 27 − 9 cells; 20 m away 4 × 4 more.
        places.extend(grid(4, 4).iter().map(|place| place + nalgebra::Vector2::new(20.0, 0.0)));
        let mut areas: Vec<f64> = Raster::of(&places, 1.0).outlines().iter().map(|outline| area(outline)).collect();
        areas.sort_by(f64::total_cmp);
        assert_eq!(areas.len(), 2);
        // The disc does not reach into the inner corner: of it three cells are filled.
        assert!((areas[0] - 16.0).abs() < 1e-9 && (areas[1] - 46.0).abs() < 1e-9, "{areas:?}");
    }

    #[test]
    fn gaps_are_closed_and_nonsense_is_empty() {
        let places: Vec<Point2<f64>> =
            grid(7, 7).into_iter().filter(|place| (place.x, place.y) != (3.5, 3.5)).collect();
        assert_eq!(Raster::of(&places, 1.0).occupied(), 49);
        assert_eq!(Raster::of(&[], 1.0).outlines(), Vec::<Vec<Point2<f64>>>::new());
        assert_eq!(Raster::of(&[Point2::new(f64::NAN, 0.0)], 1.0).occupied(), 0);
    }
}
