//! What the tests read in Rust files: items and functions by the parser `syn`, and the paths that a file
//! names, macros included, by a scanner that blanks comments and literals and unfolds `use` trees.

use std::ops::RangeInclusive;

use syn::spanned::Spanned as _;
use syn::visit::{self, Visit};
use syn::{Attribute, Block, ImplItemFn, Item, ItemFn, Signature, TraitItemFn};

use crate::functions::Function;

/// A path such as `crate::depth::Encoding`, and the line it is on.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct NamedPath {
    pub(crate) segments: Vec<String>,
    pub(crate) line: usize,
}

/// A word or a sign, and its line.
#[derive(Debug, Clone)]
pub(crate) struct Token {
    pub(crate) text: String,
    pub(crate) line: usize,
}

/// The text with all tests blanked, wherever they are in the file; lines stay where they were.
pub(crate) fn without_tests(text: &str) -> String {
    let tests = test_lines(text);
    let line = |(index, line)| if tests.iter().any(|range| range.contains(&(index + 1))) { "" } else { line };
    text.lines().enumerate().map(line).flat_map(|line| [line, "\n"]).collect()
}

/// How many lines of a file are not tests.
pub(crate) fn code_lines(text: &str) -> usize {
    let tests: usize = test_lines(text).into_iter().map(Iterator::count).sum();
    text.lines().count() - tests
}

/// The functions of a file that are not tests.
pub(crate) fn functions(path: &str, text: &str) -> Vec<Function> {
    let mut found = Functions(Vec::new());
    found.visit_file(&syn::parse_file(text).unwrap_or_else(|error| panic!("{path}: {error}")));
    found.0
}

struct Functions(Vec<Function>);

impl Functions {
    fn add(&mut self, signature: &Signature, body: &Block) {
        let (line, end) = (signature.span().start().line, body.span().end().line);
        self.0.push(Function { name: signature.ident.to_string(), line, lines: end + 1 - line });
    }
}

impl<'ast> Visit<'ast> for Functions {
    fn visit_item(&mut self, item: &'ast Item) {
        if !is_test(attributes(item)) {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_fn(&mut self, function: &'ast ItemFn) {
        self.add(&function.sig, &function.block);
        visit::visit_item_fn(self, function);
    }

    fn visit_impl_item_fn(&mut self, function: &'ast ImplItemFn) {
        self.add(&function.sig, &function.block);
        visit::visit_impl_item_fn(self, function);
    }

    fn visit_trait_item_fn(&mut self, function: &'ast TraitItemFn) {
        function.default.iter().for_each(|body| self.add(&function.sig, body));
        visit::visit_trait_item_fn(self, function);
    }
}

/// The lines of all items that are compiled for tests alone, with their attributes.
fn test_lines(text: &str) -> Vec<RangeInclusive<usize>> {
    struct Tests(Vec<RangeInclusive<usize>>);
    impl<'ast> Visit<'ast> for Tests {
        fn visit_item(&mut self, item: &'ast Item) {
            if is_test(attributes(item)) {
                self.0.push(item.span().start().line..=item.span().end().line);
            } else {
                visit::visit_item(self, item);
            }
        }
    }
    let mut tests = Tests(Vec::new());
    if !text.contains("test)]") && !text.contains("[test]") {
        return tests.0; // parsing takes most of the time of these checks
    }
    // What is no Rust file has no tests.
    syn::parse_file(text).iter().for_each(|file| tests.visit_file(file));
    tests.0
}

/// Whether an item has the attribute `#[test]` or `#[cfg(test)]`.
fn is_test(attributes: &[Attribute]) -> bool {
    let is_cfg_test = |attribute: &Attribute| {
        attribute.path().is_ident("cfg")
            && attribute.parse_args::<syn::Ident>().is_ok_and(|word| word == "test")
    };
    attributes.iter().any(|attribute| attribute.path().is_ident("test") || is_cfg_test(attribute))
}

fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Trait(item) => &item.attrs,
        Item::Type(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

/// Whether the whole file is test code.
pub(crate) fn is_test_file(path: &str) -> bool {
    path.contains("/tests/") || path.starts_with("tests/") || path.ends_with("/tests.rs")
}

/// The text with comments and literals blanked; lines stay where they were.
pub(crate) fn code_only(text: &str) -> String {
    let mut code = String::with_capacity(text.len());
    let mut rest = text;
    while !rest.is_empty() {
        let blank = comment(rest).or_else(|| raw_string(rest)).or_else(|| quoted(rest));
        let length = match blank {
            Some(length) => {
                code.extend(rest[..length].chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
                length
            }
            None => {
                let word = rest.find(|c: char| !is_word(c)).unwrap_or(rest.len());
                let length = word.max(rest.chars().next().map_or(0, char::len_utf8));
                code.push_str(&rest[..length]);
                length
            }
        };
        rest = &rest[length..];
    }
    code
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Length of the comment that `text` begins with; block comments nest.
fn comment(text: &str) -> Option<usize> {
    if text.starts_with("//") {
        return Some(text.find('\n').unwrap_or(text.len()));
    }
    if !text.starts_with("/*") {
        return None;
    }
    let mut depth = 0_usize;
    let mut at = 0;
    while at < text.len() {
        let rest = &text.as_bytes()[at..];
        if rest.starts_with(b"/*") {
            depth += 1;
            at += 2;
        } else if rest.starts_with(b"*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                return Some(at);
            }
        } else {
            at += 1;
        }
    }
    Some(text.len())
}

/// Length of the raw string (`r"..."`, `br#"..."#`) that `text` begins with.
fn raw_string(text: &str) -> Option<usize> {
    let prefix = ["br", "cr", "r"].into_iter().find(|prefix| text.starts_with(prefix))?;
    let hashes = text[prefix.len()..].bytes().take_while(|&byte| byte == b'#').count();
    let body = prefix.len() + hashes;
    text[body..].starts_with('"').then(|| {
        let close = format!("\"{}", "#".repeat(hashes));
        text[body + 1..].find(&close).map_or(text.len(), |end| body + 1 + end + close.len())
    })
}

/// Length of the string or character that `text` begins with; a lifetime is neither.
fn quoted(text: &str) -> Option<usize> {
    let quote = text.chars().next().filter(|&c| c == '"' || c == '\'')?;
    let mut characters = text.char_indices().skip(1).peekable();
    if quote == '\'' {
        let (_, first) = characters.peek().copied()?;
        let third = text[1..].chars().nth(1);
        if first != '\\' && third != Some('\'') {
            return None;
        }
    }
    while let Some((at, c)) = characters.next() {
        match c {
            '\\' => drop(characters.next()),
            c if c == quote => return Some(at + 1),
            _ => {}
        }
    }
    Some(text.len())
}

/// The words and signs of code without comments and literals.
pub(crate) fn tokens(code: &str) -> Vec<Token> {
    let mut tokens = Vec::new();
    for (index, line) in code.lines().enumerate() {
        let mut rest = line.trim_start();
        while let Some(first) = rest.chars().next() {
            let length = if is_word(first) {
                rest.find(|c: char| !is_word(c)).unwrap_or(rest.len())
            } else if rest.starts_with("::") {
                2
            } else {
                first.len_utf8()
            };
            tokens.push(Token { text: rest[..length].to_owned(), line: index + 1 });
            rest = rest[length..].trim_start();
        }
    }
    tokens
}

/// All paths that Rust code names, those in `use` trees unfolded. Single words are paths of one segment.
pub(crate) fn paths(text: &str) -> Vec<NamedPath> {
    let tokens = tokens(&code_only(text));
    let mut found = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        if tokens[at].text == "use" {
            at = unfold(&tokens, at + 1, &[], &mut found);
        } else if tokens[at].text.starts_with(is_word) {
            let (path, next) = simple(&tokens, at);
            found.push(path);
            at = next;
        } else {
            at += 1;
        }
    }
    found
}

/// The path without groups that begins at `at`, and where it ends.
fn simple(tokens: &[Token], mut at: usize) -> (NamedPath, usize) {
    let line = tokens[at].line;
    let mut segments = vec![tokens[at].text.clone()];
    at += 1;
    while at + 1 < tokens.len() && tokens[at].text == "::" && tokens[at + 1].text.starts_with(is_word) {
        segments.push(tokens[at + 1].text.clone());
        at += 2;
    }
    (NamedPath { segments, line }, at)
}

/// Add the leaves of the `use` tree at `at`, below `prefix`; returns where the tree ends.
fn unfold(tokens: &[Token], mut at: usize, prefix: &[String], found: &mut Vec<NamedPath>) -> usize {
    let mut segments = prefix.to_vec();
    while at < tokens.len() {
        match tokens[at].text.as_str() {
            "::" => at += 1,
            "{" => return group(tokens, at + 1, &segments, found),
            "as" => at += 2,
            text if text.starts_with(is_word) || text == "*" => {
                segments.push(text.to_owned());
                at += 1;
            }
            _ => break,
        }
    }
    let line = tokens[at.saturating_sub(1).min(tokens.len() - 1)].line;
    found.push(NamedPath { segments, line });
    at
}

fn group(tokens: &[Token], mut at: usize, prefix: &[String], found: &mut Vec<NamedPath>) -> usize {
    while at < tokens.len() {
        match tokens[at].text.as_str() {
            "}" => return at + 1,
            "," => at += 1,
            _ => at = unfold(tokens, at, prefix, found),
        }
    }
    at
}

#[test]
fn comments_and_literals_are_blanked_and_lifetimes_are_kept() {
    let text = "a /* b /* c */ d */ 'e' \"f \\\" g\" r#\"h \" i\"# '\\'' // j\n&'k str";
    let words: Vec<String> = tokens(&code_only(text)).into_iter().map(|token| token.text).collect();
    assert_eq!(words, ["a", "&", "'", "k", "str"]);
}

#[test]
fn use_trees_are_unfolded_and_keep_their_lines() {
    let text = "use std::{env, io::{self, Read as _}, time::*};\nlet x = crate::depth::decode(y);";
    let found: Vec<String> =
        paths(text).iter().map(|p| format!("{} {}", p.line, p.segments.join("::"))).collect();
    assert_eq!(
        found,
        [
            "1 std::env",
            "1 std::io::self",
            "1 std::io::Read",
            "1 std::time::*",
            "2 let",
            "2 x",
            "2 crate::depth::decode",
            "2 y",
        ]
    );
}

#[test]
fn tests_are_not_counted_as_code_wherever_they_are() {
    let text =
        "fn a() {}\n#[cfg(test)]\nmod tests;\nmod inner {\n    #[cfg(test)]\n    impl A {}\n}\nfn b() {}\n";
    assert_eq!(without_tests(text), "fn a() {}\n\n\nmod inner {\n\n\n}\nfn b() {}\n");
    assert_eq!(code_lines(text), 4);
    assert_eq!(code_lines("#[cfg(not(test))]\nfn a() {}\n"), 2);
    assert_eq!(functions("a.rs", text).len(), 2);
}
