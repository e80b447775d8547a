//! Small plots as SVG, in the colours of the page they stand in.

/// A line of points.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// What it is.
    pub name: String,
    /// x and y.
    pub points: Vec<(f64, f64)>,
}

/// A plot of lines over one axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Above it.
    pub title: String,
    /// Below the x axis.
    pub x: String,
    /// At the y axis.
    pub y: String,
    /// Whether y is logarithmic; values that are not above 0 are left out.
    pub logarithmic: bool,
    /// The least upper end of the y axis; 0: the highest point's.
    pub y_to: f64,
    /// The lines; the colours of the page go round.
    pub lines: Vec<Line>,
}

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 260.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = 110.0;
const TOP: f64 = 28.0;
const BOTTOM: f64 = 40.0;
/// Lines of more points are drawn without a mark at each.
const MARKED: usize = 60;
/// Colours of a page.
pub const COLOURS: usize = 6;

impl Plot {
    /// The plot; empty where there is nothing to draw.
    pub fn svg(&self) -> String {
        let y_of = |y: f64| if self.logarithmic { y.log10() } else { y };
        let usable = |point: &&(f64, f64)| point.0.is_finite() && y_of(point.1).is_finite();
        let all = || self.lines.iter().flat_map(|line| line.points.iter().filter(usable));
        if all().next().is_none() {
            return String::new();
        }
        let range = |values: &mut dyn Iterator<Item = f64>| {
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
        };
        let (x_low, x_high) = widened(range(&mut all().map(|(x, _)| *x)));
        let (y_low, y_high) = range(&mut all().map(|(_, y)| y_of(*y)));
        let (y_low, y_high) = if self.logarithmic {
            widened((y_low.floor(), y_high.ceil()))
        } else {
            widened((y_low.min(0.0), y_high.max(self.y_to)))
        };
        let u = |x: f64| LEFT + (x - x_low) / (x_high - x_low) * (WIDTH - LEFT - RIGHT);
        let v = |y: f64| HEIGHT - BOTTOM - (y - y_low) / (y_high - y_low) * (HEIGHT - TOP - BOTTOM);
        let mut svg = format!(
            "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0}\"><text x=\"{LEFT}\" y=\"16\" class=\"title\">{0}</text>",
            escaped(&self.title)
        );
        let (left, right, bottom) = (u(x_low), u(x_high), v(y_low));
        for tick in ticks(y_low, y_high, self.logarithmic) {
            let label = if self.logarithmic { short(10f64.powf(tick)) } else { short(tick) };
            let at = v(tick);
            svg.push_str(&format!(
                "<line x1=\"{left:.1}\" x2=\"{right:.1}\" y1=\"{at:.1}\" y2=\"{at:.1}\" class=\"grid\"/>"
            ));
            svg.push_str(&format!(
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                left - 6.0,
                at + 4.0
            ));
        }
        for tick in ticks(x_low, x_high, false) {
            let (at, below) = (u(tick), bottom + 15.0);
            svg.push_str(&format!(
                "<text x=\"{at:.1}\" y=\"{below:.1}\" text-anchor=\"middle\">{}</text>",
                short(tick)
            ));
        }
        let middle = 0.5 * (left + right);
        svg.push_str(&format!(
            "<text x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            HEIGHT - 8.0,
            escaped(&self.x)
        ));
        svg.push_str(&format!("<text x=\"{:.1}\" y=\"{:.1}\">{}</text>", right + 8.0, TOP + 2.0, escaped(&self.y)));
        for (n, line) in self.lines.iter().enumerate() {
            let places: Vec<(f64, f64)> =
                line.points.iter().filter(usable).map(|(x, y)| (u(*x), v(y_of(*y)))).collect();
            let path: Vec<String> = places.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
            let colour = n % COLOURS;
            svg.push_str(&format!("<polyline points=\"{}\" class=\"of{colour}\"/>", path.join(" ")));
            // Where points are dense they are the line.
            for (x, y) in places.iter().filter(|_| places.len() <= MARKED) {
                svg.push_str(&format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.6\" class=\"of{colour}\"/>"));
            }
            let at = TOP + 20.0 + 15.0 * n as f64;
            svg.push_str(&format!(
                "<text x=\"{:.1}\" y=\"{at:.1}\" class=\"of{colour}\">{}</text>",
                right + 8.0,
                escaped(&line.name)
            ));
        }
        svg + "</svg>"
    }
}

/// A range that is none gets some width.
fn widened((low, high): (f64, f64)) -> (f64, f64) {
    if high - low > 1e-9 { (low, high) } else { (low - 0.5, high + 0.5) }
}

/// Four to eight round numbers of a range; powers of ten of a logarithmic one.
fn ticks(low: f64, high: f64, logarithmic: bool) -> Vec<f64> {
    let rough = (high - low) / 5.0;
    let decade = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|n| n * decade).find(|step| *step >= rough).unwrap_or(rough);
    let step = if logarithmic { step.ceil().max(1.0) } else { step };
    let first = (low / step).ceil() as i64;
    (first..first + 12).map(|n| n as f64 * step).take_while(|tick| *tick <= high + 1e-9 * step).collect()
}

/// A number as short as it may be.
fn short(number: f64) -> String {
    if number != 0.0 && number.abs() < 5e-4 {
        return format!("{number:.0e}");
    }
    let text = format!("{number:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text.is_empty() || text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A text as HTML has it.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(logarithmic: bool, points: &[(f64, f64)]) -> String {
        let lines = vec![Line { name: "a<b".to_owned(), points: points.to_vec() }];
        Plot { title: "t".to_owned(), x: "x".to_owned(), y: "y".to_owned(), logarithmic, y_to: 0.0, lines }.svg()
    }

    #[test]
    fn ticks_are_round_and_within_the_range() {
        assert_eq!(ticks(0.0, 100.0, false), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(ticks(-1.0, 2.0, true), [-1.0, 0.0, 1.0, 2.0]);
        assert_eq!(short(0.250), "0.25");
        assert_eq!(short(-0.0), "0");
        assert_eq!(short(1e-4), "1e-4");
    }

    #[test]
    fn every_point_is_drawn_that_can_be() {
        let svg = plot(false, &[(0.0, 1.0), (1.0, 2.0), (f64::NAN, 1.0)]);
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(svg.contains("a&lt;b") && !svg.contains("NaN"));
        // The logarithm of 0 is left out.
        assert_eq!(plot(true, &[(0.0, 0.0), (1.0, 10.0)]).matches("<circle").count(), 1);
        assert_eq!(plot(true, &[(0.0, 0.0)]), "");
    }
}
