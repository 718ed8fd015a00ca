//! The frame of every HTML report: one self-contained file, readable on screen and in print.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::table::Table;

const STYLE: &str = include_str!("page.css");

/// A whole page around `body`; nothing is loaded from anywhere.
pub fn page(title: &str, body: Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { main { h1 { (title) } (body) } }
        }
    }
    .into_string()
}

/// A plot with its caption.
pub fn figure(caption: &str, svg: String) -> Markup {
    html! { figure { (PreEscaped(svg)) figcaption { (caption) } } }
}

/// A table of texts; the first column is a name, the others are figures.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> Markup {
    Table::new(head.iter().copied(), rows.to_vec()).markup()
}

/// Whether requirements hold, in words and by colour.
pub fn verdict(met: bool, text: &str) -> Markup {
    html! { p class=(if met { "met" } else { "missed" }) { (text) } }
}

/// That every requirement holds, or a line for each that does not.
pub fn verdicts(missed: &[String]) -> Markup {
    html! {
        @if missed.is_empty() {
            (verdict(true, "Every requirement is met."))
        } @else {
            @for line in missed { (verdict(false, line)) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_escapes_text_and_loads_nothing() {
        let page = page("a < b", table(&["x"], &[vec!["<script>".into()]]));
        assert!(page.contains("a &lt; b") && page.contains("&lt;script&gt;"));
        assert!(!page.contains("src=") && !page.contains("href="));
    }
}
