//! Figures: what a command found, each said once.
//!
//! A [`Figure`] is a value under a key of `--json`. Of one list of them come the JSON object, the
//! tables on the terminal and on the page, and the sentences about limits that were missed:
//!
//! ```text
//! figure("jitter_us_max", jitter)            printed by --json alone
//!     .shown("jitter, worst", "us", 1)       in the tables as well, with a unit and decimals
//!     .limit(Below(100.0))                   held to a limit, whose words are made of the number
//! figure("loop", [...])                      an object of figures
//! rows("runs", [[...], [...]])               an array of objects: a table with a row for each
//! shown("servo supply", "4.8 V")             a line of the tables that --json has elsewhere
//! note("They do not fit one another.")       a paragraph on the terminal
//! ```

mod limit;

use std::path::Path;

use anyhow::Result;
use serde::{Serialize, Serializer};
use serde_json::value::RawValue;

use super::exit::Verdict;
use super::file::{hand_over, print, print_json};
use super::table::Table;
pub use limit::Limit;

/// What `--json` prints for a figure.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A measured number.
    Real(f64),
    /// A number of things.
    Count(u64),
    /// Yes or no.
    Flag(bool),
    /// A name or words.
    Text(String),
    /// `null`: it was not to be had.
    Missing,
    /// Anything else, as JSON.
    Data(Box<RawValue>),
    /// An object.
    #[serde(serialize_with = "object")]
    Group(Vec<Figure>),
    /// An array; of objects, it is a table.
    #[serde(serialize_with = "array")]
    Rows(Vec<Figure>),
}

fn object<S: Serializer>(figures: &[Figure], serializer: S) -> Result<S::Ok, S::Error> {
    let with_key = figures.iter().filter(|figure| !figure.key.is_empty());
    serializer.collect_map(with_key.map(|figure| (figure.key, &figure.value)))
}

fn array<S: Serializer>(figures: &[Figure], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(figures.iter().map(|figure| &figure.value))
}

/// Implements `From` for what a variant of [`Value`] is made of.
macro_rules! value_from {
    ($($variant:ident from $($kind:ty),+;)+) => {
        $($(impl From<$kind> for Value {
            fn from(value: $kind) -> Self {
                Self::$variant(value.into())
            }
        })+)+
    };
}

value_from! {
    Real from f64;
    Count from u64, u32, u16;
    Flag from bool;
    Text from String, &str;
    Group from Vec<Figure>;
}

impl From<usize> for Value {
    fn from(count: usize) -> Self {
        Self::Count(count as u64)
    }
}

impl<const N: usize> From<[Figure; N]> for Value {
    fn from(figures: [Figure; N]) -> Self {
        Self::Group(figures.into())
    }
}

impl<T: Into<Value>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

/// A value under a key of `--json`, with what the tables say of it and what it is held to.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Empty for a line of the tables that is no member of the object.
    key: &'static str,
    value: Value,
    /// Empty for what the tables leave out.
    label: String,
    unit: &'static str,
    decimals: usize,
    /// The tables show the value multiplied by this.
    scale: f64,
    /// What the tables show in place of a value that is missing.
    missing: &'static str,
    /// What the tables show in place of the value.
    words: Option<String>,
    limit: Option<Limit>,
}

/// A figure that the tables leave out, until it is [`shown`](Figure::shown).
pub fn figure(key: &'static str, value: impl Into<Value>) -> Figure {
    Figure {
        key,
        value: value.into(),
        label: String::new(),
        unit: "",
        decimals: 0,
        scale: 1.0,
        missing: "none",
        words: None,
        limit: None,
    }
}

/// An array of figures, or of objects of figures: a table with a row for each.
pub fn rows<T: Into<Value>>(key: &'static str, rows: impl IntoIterator<Item = T>) -> Figure {
    let rows = rows.into_iter().map(|row| figure("", row)).collect();
    figure(key, Value::Rows(rows))
}

/// Anything that serialises, as it does.
pub fn data(key: &'static str, data: &impl Serialize) -> Figure {
    // What the commands hand over are maps with text keys, arrays and numbers: they serialise.
    let json = serde_json::value::to_raw_value(data).unwrap_or_default();
    figure(key, Value::Data(json))
}

/// The first few of many texts, for words beside data that `--json` has whole.
pub fn some(texts: impl ExactSizeIterator<Item = String>) -> String {
    const SHOWN: usize = 5;
    let more = texts.len().saturating_sub(SHOWN);
    let shown = texts.take(SHOWN).collect::<Vec<_>>().join(", ");
    match more {
        0 if shown.is_empty() => "none".into(),
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// A line of the tables that is no member of the object.
pub fn shown(label: impl Into<String>, words: impl Into<String>) -> Figure {
    figure("", Value::Missing).said(label, words)
}

/// A paragraph that stands below the tables on a terminal.
pub fn note(words: impl Into<String>) -> Figure {
    shown("", words)
}

impl Figure {
    /// Shows the value in the tables under this label.
    pub fn shown(mut self, label: impl Into<String>, unit: &'static str, decimals: usize) -> Self {
        (self.label, self.unit, self.decimals) = (label.into(), unit, decimals);
        self
    }

    /// Shows `words` in the tables under this label, in place of the value.
    pub fn said(mut self, label: impl Into<String>, words: impl Into<String>) -> Self {
        (self.label, self.words) = (label.into(), Some(words.into()));
        self
    }

    /// The same in `--json`; the tables leave it out.
    pub fn unseen(self) -> Self {
        data(self.key, &self.value)
    }

    /// The tables multiply the value, and its limit, by `scale`.
    pub fn scaled(mut self, scale: f64) -> Self {
        self.scale = scale;
        self
    }

    /// What the tables show where the value is missing, in place of "none"; where that is empty,
    /// the value has no line.
    pub fn or(mut self, missing: &'static str) -> Self {
        self.missing = missing;
        self
    }

    /// Holds the figure to a limit; a value that is missing misses it.
    pub fn limit(mut self, limit: impl Into<Option<Limit>>) -> Self {
        self.limit = limit.into();
        self
    }

    /// Whether it has no limit or meets it.
    pub fn is_met(&self) -> bool {
        let number = match self.value {
            Value::Real(number) => number,
            Value::Count(count) => count as f64,
            Value::Flag(flag) => f64::from(u8::from(flag)),
            _ => f64::NAN,
        };
        self.limit.is_none_or(|limit| limit.met_by(number))
    }

    /// The value as the tables show it, without its unit.
    fn cell(&self) -> String {
        match &self.value {
            _ if self.words.is_some() => self.words.clone().unwrap_or_default(),
            Value::Real(number) => self.rounded(*number),
            Value::Count(count) => count.to_string(),
            Value::Flag(flag) => if *flag { "yes" } else { "no" }.into(),
            Value::Text(text) => text.clone(),
            _ => self.missing.into(),
        }
    }

    /// The number with its decimals, or with up to three more where a number that misses its limit
    /// would seem to meet it.
    fn rounded(&self, number: f64) -> String {
        let text = |places: usize| format!("{:.places$}", number * self.scale);
        let misleads = |text: &String| {
            let shown = text.parse().map_or(f64::NAN, |shown: f64| shown / self.scale);
            self.limit.is_some_and(|limit| !limit.met_by(number) && limit.met_by(shown))
        };
        let mut texts = (self.decimals..=self.decimals + 3).map(text);
        texts.find(|text| !misleads(text)).unwrap_or_else(|| text(self.decimals))
    }

    /// The value with its unit.
    fn amount(&self) -> String {
        match self.value {
            Value::Missing => self.cell(),
            _ => format!("{} {}", self.cell(), self.unit).trim_end().into(),
        }
    }

    /// What the tables call it.
    pub fn label(&self) -> &str {
        &self.label
    }

    /// The limit in words; empty without one.
    pub fn required(&self) -> String {
        let words = self.limit.map(|limit| limit.words(self.scale));
        words.unwrap_or_default()
    }

    /// Label, value and limit in one sentence.
    pub fn sentence(&self) -> String {
        let required = self.required();
        let rest = if required.is_empty() { "" } else { ", required: " };
        format!("{}: {}{rest}{required}", self.label, self.amount())
    }

    /// The figure itself or those in it that the tables show, tables in it left out unless
    /// `with_rows`.
    fn leaves(&self, with_rows: bool) -> Vec<&Self> {
        match &self.value {
            Value::Group(inner) => inner.iter().flat_map(|f| f.leaves(with_rows)).collect(),
            Value::Rows(inner) if with_rows => inner.iter().flat_map(|f| f.leaves(true)).collect(),
            // Without words for it, a missing value is left out of the lines.
            Value::Missing if !with_rows && self.cell().is_empty() => Vec::new(),
            _ if self.label.is_empty() => Vec::new(),
            _ => vec![self],
        }
    }

    /// The rows of a table in which something is shown.
    fn table_rows(&self) -> impl Iterator<Item = Vec<&Self>> {
        let inner: &[Self] = match &self.value {
            Value::Rows(inner) => inner,
            _ => &[],
        };
        let leaves = inner.iter().map(|row| row.leaves(true));
        leaves.filter(|leaves| !leaves.is_empty())
    }

    /// The table of a figure that has rows, empty for another one. A limit that all rows share
    /// stands in the head.
    pub fn table(&self) -> Table {
        let rows: Vec<Vec<&Self>> = self.table_rows().collect();
        let head = rows.first().into_iter().flatten().enumerate();
        let head = head.map(|(column, first)| {
            let mut limits = rows.iter().filter_map(|row| row.get(column)?.limit);
            let one = limits.next();
            let limit = one.filter(|one| limits.all(|limit| limit == *one));
            let limit = limit.map(|limit| format!(" ({})", limit.words(first.scale)));
            let comma = if first.unit.is_empty() { "" } else { ", " };
            format!("{}{comma}{}{}", first.label, first.unit, limit.unwrap_or_default())
        });
        let cells = |row: &Vec<&Self>| row.iter().map(|figure| figure.cell()).collect();
        Table::new(head, rows.iter().map(cells)).right_aligned()
    }

    /// Whether it, or something in it, has a limit.
    fn is_judged(&self) -> bool {
        match &self.value {
            Value::Group(inner) | Value::Rows(inner) => inner.iter().any(Self::is_judged),
            _ => self.limit.is_some(),
        }
    }

    /// Adds where each limit in it that was missed stands; the figure itself stands at `path`.
    fn add_missed(&self, path: &str, found: &mut Vec<String>) {
        match &self.value {
            Value::Group(inner) => inner.iter().for_each(|figure| {
                let dot = if path.is_empty() { "" } else { "." };
                figure.add_missed(&format!("{path}{dot}{}", figure.key), found);
            }),
            Value::Rows(inner) => inner.iter().enumerate().for_each(|(index, row)| {
                row.add_missed(&format!("{path}[{index}]"), found);
            }),
            _ if !self.is_met() => found.push(path.to_owned()),
            _ => {}
        }
    }

    /// A sentence for each limit in it that was missed; the first column names a row.
    pub fn missed(&self) -> Vec<String> {
        let sentences = |leaves: Vec<&Self>| -> Vec<String> {
            let missed = leaves.into_iter().filter(|leaf| !leaf.is_met());
            missed.map(Self::sentence).collect()
        };
        let mut all = sentences(self.leaves(false));
        for row in self.table_rows() {
            let name = format!("{} {}", row[0].label, row[0].amount());
            let missed = sentences(row).into_iter();
            all.extend(missed.map(|sentence| format!("{name}: {sentence}")));
        }
        all
    }
}

/// All figures of a command, in the order in which `--json` prints them.
#[derive(Debug, Default)]
pub struct Figures(Vec<Figure>);

impl<T: IntoIterator<Item = Figure>> From<T> for Figures {
    fn from(figures: T) -> Self {
        Self(figures.into_iter().collect())
    }
}

impl Serialize for Figures {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        object(&self.0, serializer)
    }
}

impl Figures {
    /// These figures and one more.
    pub fn and(mut self, figure: Figure) -> Self {
        self.0.push(figure);
        self
    }

    /// Label, value and limit of everything that is in no table of its own.
    pub fn lines(&self) -> Table {
        let figures = self.0.iter().flat_map(|figure| figure.leaves(false));
        let figures: Vec<&Figure> = figures.collect();
        let limited = figures.iter().any(|figure| figure.limit.is_some());
        let row = |figure: &&Figure| {
            let mut row = vec![figure.label.clone(), figure.amount()];
            if limited {
                let missed = if figure.is_met() { "" } else { " (missed)" };
                row.push(figure.required() + missed);
            }
            row
        };
        let head = if limited { &["", "measured", "required"][..] } else { &[] };
        Table::new(head.iter().copied(), figures.iter().map(row))
    }

    /// Label and value of everything that is in no table of its own.
    pub fn named(&self) -> Vec<[String; 2]> {
        let leaves = self.0.iter().flat_map(|figure| figure.leaves(false));
        leaves.map(|leaf| [leaf.label.clone(), leaf.amount()]).collect()
    }

    /// The table under a key.
    pub fn table(&self, key: &str) -> Table {
        self.0
            .iter()
            .find(|figure| figure.key == key && matches!(figure.value, Value::Rows(_)))
            .map_or_else(Table::default, Figure::table)
    }

    /// A sentence for each limit that was missed.
    pub fn missed(&self) -> Vec<String> {
        self.0.iter().flat_map(Figure::missed).collect()
    }

    /// Everything for a terminal: the tables, then the lines, then the notes.
    pub fn text(&self) -> String {
        self.in_words(Table::text)
    }

    /// The same with tables as Markdown.
    pub fn markdown(&self) -> String {
        self.in_words(Table::markdown)
    }

    fn in_words(&self, of_table: fn(&Table) -> String) -> String {
        let tables = self.0.iter().map(Figure::table).chain([self.lines()]);
        let texts = tables.filter(|table| !table.is_empty());
        let notes = self.0.iter().filter(|figure| figure.label.is_empty());
        let notes = notes.filter_map(|note| Some(format!("{}\n", note.words.as_ref()?)));
        let texts: Vec<String> = texts.map(|table| of_table(&table)).chain(notes).collect();
        texts.join("\n")
    }

    /// Where in the object each limit that was missed stands, such as `runs[1].overshoot_pct`.
    pub fn missed_keys(&self) -> Vec<String> {
        let mut found = Vec::new();
        for figure in &self.0 {
            figure.add_missed(figure.key, &mut found);
        }
        found
    }

    /// Prints the figures on standard output, as JSON or as text, then writes the page, and names
    /// on standard error what missed its limit. Where there are limits, the JSON object says under
    /// `met` whether all of them hold, and under `missed` which do not.
    ///
    /// # Errors
    /// Standard output or the page cannot be written.
    pub fn conclude(&self, json: bool, page: Option<(&Path, String)>) -> Result<Verdict> {
        let printed = match json {
            true if self.0.iter().any(Figure::is_judged) => {
                let judged = judged(self.missed_keys());
                print_json(&Self([self.0.clone(), judged].concat()))
            }
            true => print_json(self),
            false => print(self.text()),
        };
        hand_over(printed, page, &self.missed())
    }
}

/// For `--json`: whether every limit holds, and where in the object those stand that do not.
pub fn judged(missed: Vec<String>) -> Vec<Figure> {
    vec![figure("met", missed.is_empty()), rows("missed", missed)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use Limit::*;

    fn figures(jitter: f64, settling: Option<f64>) -> Figures {
        let run = [
            figure("start_rad", 0.4).shown("start", "rad", 2),
            figure("settling_s", settling)
                .shown("settling", "s", 3)
                .or("never")
                .limit(AtMost(0.75)),
        ];
        Figures::from([
            figure("seed", 7_u32),
            figure(
                "loop",
                [
                    figure("jitter_us", jitter).shown("jitter", "us", 1).limit(Below(100.0)),
                    figure("load", 0.125).shown("core awake", "%", 1).scaled(100.0),
                ],
            ),
            rows("runs", [run]),
            data("gains", &[0.1_f32]),
            shown("servo supply", "4.8 V"),
            note("That is all."),
        ])
    }

    #[test]
    fn json_has_every_key_in_order_and_nothing_else() {
        let json = serde_json::to_string(&figures(3.0, None)).unwrap();
        let expected = concat!(
            r#"{"seed":7,"loop":{"jitter_us":3.0,"load":0.125},"#,
            r#""runs":[{"start_rad":0.4,"settling_s":null}],"gains":[0.1]}"#
        );
        assert_eq!(json, expected);
    }

    #[test]
    fn the_text_has_tables_lines_and_notes() {
        let expected = " start, rad     settling, s
             (at most 0.75)
 0.40                 0.600

               measured  required
 jitter        3.0 us    below 100
 core awake    12.5 %
 servo supply  4.8 V

That is all.
";
        assert_eq!(figures(3.0, Some(0.6)).text(), expected);
    }

    #[test]
    fn what_misses_its_limit_is_named_with_its_row() {
        assert_eq!(figures(3.0, Some(0.6)).missed(), Vec::<String>::new());
        assert_eq!(
            figures(100.0, None).missed(),
            [
                "jitter: 100.0 us, required: below 100",
                "start 0.40 rad: settling: never, required: at most 0.75",
            ]
        );
    }

    #[test]
    fn a_number_that_misses_its_limit_by_little_shows_it() {
        for (number, text) in [(1.2504, "1.2504"), (1.254, "1.254"), (1.26, "1.26"), (1.25, "1.25")]
        {
            let figure = figure("ratio", number).shown("ratio", "", 2).limit(Limit::AtMost(1.25));
            assert_eq!(figure.cell(), text);
        }
    }

    #[test]
    fn what_misses_its_limit_is_named_by_its_place_in_the_object() {
        assert!(figures(3.0, Some(0.6)).missed_keys().is_empty());
        let missed = figures(100.0, None).missed_keys();
        assert_eq!(missed, ["loop.jitter_us", "runs[0].settling_s"]);
        let judged = |figures: &Figures| figures.0.iter().any(Figure::is_judged);
        assert!(judged(&figures(3.0, None)));
        assert!(!judged(&Figures::from([figure("seed", 7_u32)])));
    }

    #[test]
    fn limits_are_held_and_said_by_their_numbers() {
        for (limit, inside, outside, words) in [
            (AtMost(5.0), 5.0, 5.1, "at most 5"),
            (AtMost(0.0), 0.0, 1.0, "none"),
            (AtLeast(100.0), 100.0, 99.9, "at least 100"),
            (Below(100.0), 99.9, 100.0, "below 100"),
            (Near(0.8, 1e-9), 0.8, 0.81, "0.8 ± 1e-9"),
            (Within(2.0, 100.0), 2.0, 1.9, "2 to 100"),
            (Within(0.0, 1e-12), 0.0, 1e-11, "at most 1e-12"),
            (Within(3.0, 3.0), 3.0, 2.0, "exactly 3"),
        ] {
            assert!(limit.met_by(inside) && !limit.met_by(outside), "{words}");
            assert!(!limit.met_by(f64::NAN), "{words}");
            assert_eq!(limit.words(1.0), words);
        }
        assert!(!figure("", false).limit(Set).is_met());
        assert_eq!(AtMost(0.02).words(1e3), "at most 20");
    }
}
