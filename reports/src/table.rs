//! Tables of texts, for a terminal and for a page.

use comfy_table::presets::{ASCII_MARKDOWN, NOTHING};
use comfy_table::{CellAlignment, Table as Terminal, TableStyle};
use maud::{Markup, html};

/// Width of a head's lines on a terminal, where its words are not longer.
const HEAD_WIDTH: usize = 15;

/// A table of texts; the first column names the row.
#[derive(Debug, Default)]
pub struct Table {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
    right_aligned: bool,
}

impl Table {
    /// A table with this head, or none, aligned to the left.
    pub fn new<T: Into<String>>(
        head: impl IntoIterator<Item = T>,
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> Self {
        Self {
            head: head.into_iter().map(Into::into).collect(),
            rows: rows.into_iter().collect(),
            right_aligned: false,
        }
    }

    /// Aligns columns with numbers, all but the first, to the right on a terminal.
    pub fn right_aligned(mut self) -> Self {
        self.right_aligned = true;
        self
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// For a terminal, with an end of line behind each row.
    pub fn text(&self) -> String {
        self.in_style(NOTHING)
    }

    /// As Markdown, with an end of line behind each row.
    pub fn markdown(&self) -> String {
        self.in_style(ASCII_MARKDOWN)
    }

    fn in_style(&self, style: TableStyle) -> String {
        let mut table = Terminal::new();
        table.load_style(style).add_rows(&self.rows);
        if !self.head.is_empty() {
            table.set_header(self.head.iter().map(|cell| wrapped(cell)));
        }
        if self.right_aligned {
            // Some have commas between thousands.
            let is_number = |cell: &String| cell.replace(',', "").parse::<f64>().is_ok();
            let has_numbers = |at| self.rows.iter().any(|row| row.get(at).is_some_and(is_number));
            for (_, column) in
                table.column_iter_mut().enumerate().skip(1).filter(|c| has_numbers(c.0))
            {
                column.set_cell_alignment(CellAlignment::Right);
            }
        }
        table.trim_fmt() + "\n"
    }

    /// For a page; empty without rows.
    pub fn markup(&self) -> Markup {
        html! {
            @if !self.is_empty() {
                table {
                    thead { tr { @for cell in &self.head { th { (cell) } } } }
                    tbody { @for row in &self.rows { tr { @for cell in row { td { (cell) } } } } }
                }
            }
        }
    }
}

/// A head in lines of at most [`HEAD_WIDTH`], where its words allow it: heads that say unit and
/// limit are wider than their columns. What stands in brackets begins a line unless all of it fits.
fn wrapped(head: &str) -> String {
    let mut lines = String::new();
    let mut width = 0;
    let mut rest = head;
    while let Some(word) = rest.split(' ').next().filter(|_| !rest.is_empty()) {
        let whole = match word.starts_with('(') {
            true => rest.find(')').map_or(rest.len(), |end| end + 1),
            false => word.len(),
        };
        if width > 0 {
            let fits = width + 1 + whole <= HEAD_WIDTH;
            lines.push(if fits { ' ' } else { '\n' });
            width = if fits { width + 1 } else { 0 };
        }
        lines.push_str(word);
        width += word.len();
        rest = rest[word.len()..].trim_start();
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::wrapped;

    #[test]
    fn heads_break_between_words() {
        assert_eq!(wrapped("settling, s"), "settling, s");
        assert_eq!(wrapped("latency, us (at most 8000)"), "latency, us\n(at most 8000)");
        assert_eq!(wrapped("incomprehensible"), "incomprehensible");
    }
}
