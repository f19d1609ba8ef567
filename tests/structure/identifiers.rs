//! Names that were replaced do not return as names of types, functions, fields, parameters and variables.
//! Many of them are fine words in a sentence, so only definitions are searched. `vocabulary.rs` has the words
//! that are wrong everywhere.

use proc_macro2::Ident;
use syn::visit::{self, Visit};
use syn::{Field, Item, PatIdent, Signature, Variant};

use crate::assert_none;
use crate::rust_source::{Token, code_only, tokens};
use crate::{python_source, repository};

/// Names that say too little for a type, and what to write instead.
const TYPES: [(&str, &str); 16] = [
    ("Bell", "Notify"),
    ("Kind", "what it is a kind of, as in `SampleKind`"),
    ("Lane", "StreamState"),
    ("Look", "what is read, as in `TopicContent`"),
    ("Opening", "OpenOptions, WallOpening"),
    ("Optics", "CameraResolver, Intrinsics"),
    ("Outlet", "ShmPublisher"),
    ("Own", "ForkGuard"),
    ("Player", "StreamTask, ImageReplay"),
    ("Port", "what it connects, as in `TopicPublisher`"),
    ("Side", "what it is a side of"),
    ("Trouble", "an error, as in `SourceError`"),
    ("Turn", "Poll, CreationLock, Rotation"),
    ("Way", "what it is a way of, as in `ReadMode`"),
    ("What", "what it is, as in `SampleKind`"),
    ("Wish", "RequestedMode"),
];

/// Names that say too little for anything else.
const OTHERS: [(&str, &str); 12] = [
    ("Arguments", "Argument, the kind of an error of a wrong value"),
    ("BadArguments", "Argument"),
    ("InvalidArgument", "Argument"),
    ("hush", "silence_logs"),
    ("look", "poll, read, check"),
    ("looks", "polls, contents"),
    ("remains", "StreamSummary"),
    ("said", "message, stderr, printed"),
    ("take_through", "handle_frame"),
    ("take_turns", "run_round_robin"),
    ("tell", "send, log, report_stats"),
    ("way", "path, direction"),
];

/// A name where it is defined.
#[derive(Debug, PartialEq, Eq)]
struct Definition {
    name: String,
    line: usize,
    is_type: bool,
}

impl Definition {
    fn problem(&self, path: &str) -> Option<String> {
        let replaced: &[(&str, &str)] = if self.is_type { &TYPES } else { &OTHERS };
        let name = self.name.trim_start_matches('_');
        let (_, better) = replaced.iter().find(|(old, _)| *old == name)?;
        Some(format!("{path}:{}: the name `{}` was replaced; write: {better}", self.line, self.name))
    }
}

#[derive(Default)]
struct Definitions(Vec<Definition>);

impl Definitions {
    fn add(&mut self, ident: &Ident, is_type: bool) {
        let line = ident.span().start().line;
        self.0.push(Definition { name: ident.to_string(), line, is_type });
    }
}

impl<'ast> Visit<'ast> for Definitions {
    fn visit_item(&mut self, item: &'ast Item) {
        match item {
            Item::Enum(item) => self.add(&item.ident, true),
            Item::Struct(item) => self.add(&item.ident, true),
            Item::Trait(item) => self.add(&item.ident, true),
            Item::Type(item) => self.add(&item.ident, true),
            Item::Union(item) => self.add(&item.ident, true),
            Item::Mod(item) => self.add(&item.ident, false),
            _ => {}
        }
        visit::visit_item(self, item);
    }

    fn visit_signature(&mut self, signature: &'ast Signature) {
        self.add(&signature.ident, false);
        visit::visit_signature(self, signature);
    }

    fn visit_field(&mut self, field: &'ast Field) {
        field.ident.iter().for_each(|ident| self.add(ident, false));
        visit::visit_field(self, field);
    }

    fn visit_variant(&mut self, variant: &'ast Variant) {
        self.add(&variant.ident, false);
        visit::visit_variant(self, variant);
    }

    fn visit_pat_ident(&mut self, pattern: &'ast PatIdent) {
        self.add(&pattern.ident, false);
        visit::visit_pat_ident(self, pattern);
    }
}

fn rust(path: &str, text: &str) -> Vec<Definition> {
    let mut found = Definitions::default();
    found.visit_file(&syn::parse_file(text).unwrap_or_else(|error| panic!("{path}: {error}")));
    found.0
}

/// Finds path, name, line, and whether it is a type. Of attributes, those of `self` are defined here.
const PYTHON_DEFINITIONS: &str = "
for path, text in files:
    for node in ast.walk(ast.parse(text, path)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            name = node.name
        elif isinstance(node, ast.arg):
            name = node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            name = node.id
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == 'self':
            name = node.attr
        else:
            continue
        found.append((path, name, node.lineno, isinstance(node, ast.ClassDef)))
";

fn python(files: &[(String, String)]) -> Vec<(String, Definition)> {
    let found: Vec<(String, String, usize, bool)> = python_source::run(PYTHON_DEFINITIONS, files);
    found.into_iter().map(|(path, name, line, is_type)| (path, Definition { name, line, is_type })).collect()
}

/// The words of C and C++. Uses count too, because each name is defined somewhere.
fn c(text: &str) -> Vec<Definition> {
    let tokens = tokens(&code_only(text));
    let is_type = |word: &str| ["struct", "class", "enum", "union", "typename", "using"].contains(&word);
    let before = std::iter::once("").chain(tokens.iter().map(|token| token.text.as_str()));
    let words = before.zip(&tokens);
    let definition = |(before, word): (&str, &Token)| Definition {
        name: word.text.clone(),
        line: word.line,
        is_type: is_type(before),
    };
    words.map(definition).collect()
}

/// The variables and functions of a shell script: what is before `=`, `()`, and after `for`, `local` and
/// `read`.
fn shell(text: &str) -> Vec<Definition> {
    let mut found = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let mut before = "";
        for word in line.split([' ', '\t', ';', '&', '|']).filter(|word| !word.is_empty()) {
            let end = word.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(word.len());
            let (name, rest) = word.split_at(end);
            let is_declared = ["for", "local", "read", "export", "readonly"].contains(&before);
            if is_declared || rest.starts_with('=') || rest.starts_with("()") {
                found.push(Definition { name: name.to_owned(), line: index + 1, is_type: false });
            }
            before = word;
        }
    }
    found
}

fn is_shell(path: &str, text: &str) -> bool {
    path.ends_with(".sh")
        || text.lines().next().is_some_and(|line| line.starts_with("#!") && line.ends_with("sh"))
}

#[test]
fn no_replaced_name_is_defined() {
    let files = repository::texts(|_| true);
    let ends = |path: &str, endings: &[&str]| endings.iter().any(|ending| path.ends_with(ending));
    let mut problems = Vec::new();
    for (path, text) in &files {
        let found = match path.as_str() {
            path if ends(path, &[".rs"]) => rust(path, text),
            path if ends(path, &[".c", ".h", ".cpp", ".hpp"]) => c(text),
            path if is_shell(path, text) => shell(text),
            _ => Vec::new(),
        };
        problems.extend(found.iter().filter_map(|definition| definition.problem(path)));
    }
    let python_files: Vec<_> = files.into_iter().filter(|(path, _)| ends(path, &[".py", ".pyi"])).collect();
    problems.extend(python(&python_files).iter().filter_map(|(path, definition)| definition.problem(path)));
    assert_none(&problems);
}

fn count(found: &[Definition]) -> usize {
    found.iter().filter(|definition| definition.problem("a").is_some()).count()
}

#[test]
fn a_replaced_name_is_found_in_every_language() {
    let text = "enum Kind { Tell { said: u8 } }\nfn look(way: u8) { let _looks = |tell| 1; }\ntrait T { fn tell(); }";
    assert_eq!(count(&rust("a.rs", text)), 7);
    let text =
        "class Kind:\n    def tell(self, said, *look):\n        self.way = [looks for looks in said]\n";
    let found: Vec<_> = python(&[("a.py".into(), text.into())]).into_iter().map(|(_, found)| found).collect();
    assert_eq!(count(&found), 6);
    assert_eq!(count(&c("struct Kind { int way; };\nvoid tell(int look);")), 4);
    assert_eq!(count(&shell("said=$(date)\ntell() { echo; }\nfor look in 1; do local way; done")), 4);
}

#[test]
fn the_same_word_elsewhere_and_longer_names_are_fine() {
    assert_eq!(count(&rust("a.rs", "// look\nenum ErrorKind { A }\nfn look_up() { a.tell(\"way\"); }")), 0);
    let text = "\"\"\"Look.\"\"\"\nscene.look = tell('way')\n";
    assert!(python(&[("a.py".into(), text.into())]).iter().all(|(_, found)| found.problem("a").is_none()));
    assert_eq!(count(&c("/* look */ enum error_kind { A }; // way\nprintf(\"tell\");")), 0);
    assert_eq!(count(&shell("# tell\necho look; tell a=b")), 0);
}
