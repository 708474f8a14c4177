//! A Markdown file of tables, such as RESULTS.md, as a part of the page.
//!
//! Raw HTML in it is shown as text, and pictures and links are left as their words: the page stands by itself.

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd, html};

/// The file as HTML; its headings become one size smaller than the page's own.
pub fn html_of(markdown: &str) -> String {
    let events = Parser::new_ext(markdown, Options::ENABLE_TABLES).filter_map(|event| match event {
        Event::Html(text) | Event::InlineHtml(text) => Some(Event::Text(text)),
        Event::Start(Tag::Link { .. } | Tag::Image { .. } | Tag::HtmlBlock)
        | Event::End(TagEnd::Link | TagEnd::Image | TagEnd::HtmlBlock) => None,
        Event::Start(Tag::Heading { .. }) => Some(Event::Start(heading())),
        Event::End(TagEnd::Heading(_)) => Some(Event::End(heading().into())),
        other => Some(other),
    });
    let mut text = String::new();
    html::push_html(&mut text, events);
    text
}

fn heading() -> Tag<'static> {
    Tag::Heading { level: pulldown_cmark::HeadingLevel::H3, id: None, classes: Vec::new(), attrs: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_stay_and_markup_pictures_and_addresses_do_not() {
        let text = html_of(
            "# T\n\n| a | b |\n|---|---|\n| 1 | <i>2</i> |\n\n<script>x</script>\n\n[words](https://example.org) \
             ![picture](x.png)\n",
        );
        assert!(text.contains("<h3>T</h3>") && text.contains("<td>1</td>"), "{text}");
        assert!(text.contains("&lt;i&gt;2&lt;/i&gt;") && text.contains("&lt;script&gt;"), "{text}");
        assert!(text.contains("words") && !text.contains("http") && !text.contains("x.png"), "{text}");
    }
}
