//! From what the page says to HTML: one template, one style sheet, one script, all inside the program.

use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior, Value, context};

use super::model::Page;

/// The name's ending makes every value be escaped that is not marked as safe.
const TEMPLATE: (&str, &str) = ("report.html", include_str!("report.html"));
const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// The page as one file.
#[must_use]
pub fn html(page: &Page) -> String {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    let syntax = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    environment.set_syntax(syntax.expect("the usual delimiters are told apart"));
    environment.add_template(TEMPLATE.0, TEMPLATE.1).expect("the template was parsed by the tests");
    let template = environment.get_template(TEMPLATE.0).expect("it was added just now");
    let safe = |text: &str| Value::from_safe_string(text.to_owned());
    let page = Value::from(Serde(page));
    template
        .render(context! { page => page, style => safe(STYLE), script => safe(SCRIPT) })
        .expect("the template names only fields that the page has")
}
