//! The files that a subcommand reads and writes. No file may be both read and written, or written twice.

use std::borrow::Cow;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use nunet_core::graph::model_files;
use nunet_files::RESULT_FILES;
use nunet_source::{IMAGE_EXTENSIONS, SourceName};
use nunet_types::Hint;

use crate::error_kind::SinkErrorKind;
use crate::obstacle_images::OBSTACLE_FILES;

/// Why an output would destroy something.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilePlanError {
    /// One file has two uses, perhaps under two names.
    #[error("`{}` is both {one} and {other}", path.display())]
    Shared {
        /// The output.
        path: PathBuf,
        /// Its other use.
        one: &'static str,
        /// What would be written.
        other: &'static str,
    },
    /// An output in a folder that is read as a whole: the next run would read it too.
    #[error("{output} `{}` would be in `{}`, which is {input} and is read as a whole", path.display(), folder.display())]
    InInput {
        /// The output.
        path: PathBuf,
        /// What would be written.
        output: &'static str,
        /// The folder that is read.
        folder: PathBuf,
        /// What is read.
        input: &'static str,
    },
    /// An output that the pattern of an input matches: the next run would read it too.
    #[error("{output} `{}` would match `{pattern}`, which is {input}", path.display())]
    MatchesInput {
        /// The output.
        path: PathBuf,
        /// What would be written.
        output: &'static str,
        /// The name of the input.
        pattern: String,
        /// What is read.
        input: &'static str,
    },
}

impl FilePlanError {
    /// [`SinkErrorKind::Argument`].
    #[must_use]
    pub fn kind(&self) -> SinkErrorKind {
        SinkErrorKind::Argument
    }
}

impl Hint for FilePlanError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some("pass another output".into())
    }

    fn is_usage(&self) -> bool {
        self.kind() == SinkErrorKind::Argument
    }
}

/// A file or a folder, and its role.
#[derive(Debug)]
struct Use {
    path: PathBuf,
    role: &'static str,
}

/// The inputs and outputs of a subcommand.
#[derive(Debug, Default)]
pub struct FilePlan {
    inputs: Vec<Use>,
    outputs: Vec<Use>,
    sources: Vec<(SourceName, &'static str)>,
}

/// Device and number of a file: the same under each of its names.
type Identity = (u64, u64);

impl FilePlan {
    /// `path` is read: a file, or a folder with all the images or recordings in it.
    pub fn read(&mut self, role: &'static str, path: impl Into<PathBuf>) {
        self.inputs.push(Use { path: path.into(), role });
    }

    /// `name` is read: what it stands for now, and what it will stand for in the next run.
    pub fn read_source(&mut self, role: &'static str, name: &SourceName) {
        name.files().into_iter().for_each(|file| self.read(role, file));
        self.sources.push((name.clone(), role));
    }

    /// The files of a model are read.
    pub fn read_model(&mut self, model: &Path) {
        let files = model_files(model).unwrap_or_else(|_| vec![model.to_owned()]);
        files.into_iter().for_each(|file| self.read("the model", file));
    }

    /// `path` will be written.
    pub fn write(&mut self, role: &'static str, path: impl Into<PathBuf>) {
        self.outputs.push(Use { path: path.into(), role });
    }

    /// `folder` will be written, and `names` in it.
    pub fn write_folder<'a>(&mut self, folder: &Path, names: impl IntoIterator<Item = &'a str>) {
        self.write("the folder of the results", folder);
        names.into_iter().for_each(|name| self.write("a result", folder.join(name)));
    }

    /// The results of a frame will be written into `folder`.
    pub fn write_results(&mut self, folder: &Path) {
        self.write_folder(folder, RESULT_FILES.into_iter().chain(OBSTACLE_FILES));
    }

    /// Checks before anything is opened that every output is a file of its own.
    ///
    /// # Errors
    /// An output is an input or another output, or lies in a folder that is read.
    pub fn check(&self) -> Result<(), FilePlanError> {
        let mut existing: HashMap<Identity, &Use> = HashMap::new();
        let mut missing: HashMap<PathBuf, &Use> = HashMap::new();
        for output in &self.outputs {
            let earlier = match identity(&output.path) {
                Some(identity) => insert(existing.entry(identity), output),
                None if output.path.exists() => None, // a device can be written twice
                None => insert(missing.entry(place(&output.path)), output),
            };
            if let Some(earlier) = earlier {
                return Err(shared(output, earlier, output));
            }
        }
        for input in &self.inputs {
            let Some(found) = identity(&input.path) else { continue };
            if let Some(output) = existing.get(&found) {
                return Err(shared(output, input, output));
            }
        }
        self.check_folders(&existing)?;
        self.check_patterns()
    }

    /// No output may be one of the files that the pattern of a source matches.
    fn check_patterns(&self) -> Result<(), FilePlanError> {
        for output in &self.outputs {
            let path = place(&output.path);
            if let Some((name, input)) = self.sources.iter().find(|(name, _)| name.would_read(&path)) {
                let (path, pattern) = (output.path.clone(), name.as_str().to_owned());
                return Err(FilePlanError::MatchesInput { path, output: output.role, pattern, input });
            }
        }
        Ok(())
    }

    /// No output may be one of the files of a folder that is read.
    fn check_folders(&self, existing: &HashMap<Identity, &Use>) -> Result<(), FilePlanError> {
        for input in self.inputs.iter().filter(|input| input.path.is_dir()) {
            let folder = identity(&input.path);
            let within = |output: &&Use| {
                let path = output.path.canonicalize().unwrap_or_else(|_| place(&output.path));
                is_read_from_folders(&path) && path.parent().and_then(identity) == folder
            };
            if let Some(output) = self.outputs.iter().find(within) {
                let (path, folder) = (output.path.clone(), input.path.clone());
                return Err(FilePlanError::InInput { path, output: output.role, folder, input: input.role });
            }
            if let Some(output) = linked_from(&input.path, existing) {
                return Err(shared(output, input, output));
            }
        }
        Ok(())
    }
}

/// The output that has another name in `folder`: a symbolic link, or one of several names of the file.
fn linked_from<'a>(folder: &Path, existing: &HashMap<Identity, &'a Use>) -> Option<&'a Use> {
    let names = |output: &Use| {
        output.path.metadata().ok().filter(std::fs::Metadata::is_file).map(|file| file.nlink())
    };
    let several = existing.values().filter_map(|output| names(output)).max()? > 1;
    // The metadata of each image of a large folder takes time to read, so only where one can be an output.
    let is_link = |entry: &std::fs::DirEntry| entry.file_type().is_ok_and(|kind| kind.is_symlink());
    let mut entries = folder.read_dir().ok()?.flatten().filter(|entry| several || is_link(entry));
    entries.find_map(|entry| {
        existing.get(&identity(&entry.path())?).filter(|output| output.path.is_file()).copied()
    })
}

/// Records `output`. Returns the earlier use of the same file, if there is one.
fn insert<'a, K>(entry: Entry<'_, K, &'a Use>, output: &'a Use) -> Option<&'a Use> {
    match entry {
        Entry::Occupied(earlier) => Some(earlier.get()),
        Entry::Vacant(free) => {
            free.insert(output);
            None
        }
    }
}

fn shared(output: &Use, one: &Use, other: &Use) -> FilePlanError {
    FilePlanError::Shared { path: output.path.clone(), one: one.role, other: other.role }
}

/// Whether a folder that is read as a source would have a file of this name as a part.
fn is_read_from_folders(path: &Path) -> bool {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase()).unwrap_or_default();
    ending == "mcap" || IMAGE_EXTENSIONS.iter().any(|known| ending == *known)
}

/// `None` for what does not exist, and for devices and pipes.
fn identity(path: &Path) -> Option<Identity> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    let found = path.metadata().ok()?;
    (found.is_file() || found.is_dir()).then(|| (found.dev(), found.ino()))
}

/// The canonical form of a path: absolute, with links resolved as far as the path exists.
#[must_use]
pub fn place(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let there = path.ancestors().find_map(|there| Some((there, there.canonicalize().ok()?)));
    let resolved = there.and_then(|(there, found)| Some((found, path.strip_prefix(there).ok()?)));
    match resolved {
        // Joining nothing would add a slash.
        Some((found, rest)) if rest.as_os_str().is_empty() => found,
        Some((found, rest)) => found.join(rest),
        None => path,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Files(tempfile::TempDir);

    impl Files {
        fn new(names: &[&str]) -> Self {
            let files = Self(tempfile::tempdir().unwrap());
            for name in names {
                std::fs::create_dir_all(files.path(name).parent().unwrap()).unwrap();
                std::fs::write(files.path(name), name).unwrap();
            }
            files
        }

        fn path(&self, name: &str) -> PathBuf {
            self.0.path().join(name)
        }

        /// What is wrong with reading and writing these files; the folder of results ends with a slash.
        fn problem(&self, inputs: &[&str], outputs: &[&str]) -> Option<String> {
            let mut plan = FilePlan::default();
            inputs.iter().for_each(|name| plan.read("the source", self.path(name)));
            for name in outputs {
                match name.strip_suffix('/') {
                    Some(folder) => plan.write_results(&self.path(folder)),
                    None => plan.write("the output", self.path(name)),
                }
            }
            let root = self.0.path().to_str().unwrap().to_owned() + "/";
            plan.check().err().map(|error| error.to_string().replace(&root, ""))
        }
    }

    #[test]
    fn an_output_is_no_input_under_any_name() {
        let files = Files::new(&["in/a.mcap", "in/depth.png", "elsewhere/b.mcap"]);
        std::fs::hard_link(files.path("in/a.mcap"), files.path("hard.mcap")).unwrap();
        std::os::unix::fs::symlink(files.path("in/a.mcap"), files.path("soft.mcap")).unwrap();
        std::os::unix::fs::symlink(files.path("in"), files.path("folder")).unwrap();
        for output in ["in/a.mcap", "in/../in/a.mcap", "hard.mcap", "soft.mcap", "folder/a.mcap"] {
            let problem = files.problem(&["in/a.mcap"], &[output]);
            assert_eq!(problem.unwrap(), format!("`{output}` is both the source and the output"));
            assert!(files.problem(&["in"], &[output]).is_some(), "{output}");
        }
        let problem = files.problem(&["in/depth.png"], &["in/"]);
        assert_eq!(problem.unwrap(), "`in/depth.png` is both the source and a result");
        assert_eq!(files.problem(&["in/a.mcap"], &["elsewhere/b.mcap", "new.mcap", "new/"]), None);
    }

    #[test]
    fn an_output_is_not_what_a_link_in_an_input_folder_names() {
        let files = Files::new(&["in/a.png", "store/b.png", "results/depth.npy"]);
        std::os::unix::fs::symlink(files.path("store/b.png"), files.path("in/b.png")).unwrap();
        std::os::unix::fs::symlink(files.path("results"), files.path("in/results")).unwrap();
        let problem = files.problem(&["in"], &["store/b.png"]);
        assert_eq!(problem.unwrap(), "`store/b.png` is both the source and the output");
        assert_eq!(files.problem(&["in"], &["results/"]), None);
    }

    #[test]
    fn an_output_is_no_other_output_even_before_it_exists() {
        let files = Files::new(&["in/a.mcap"]);
        std::os::unix::fs::symlink(files.path("in"), files.path("folder")).unwrap();
        for pair in [
            ["new.json", "./new.json"],
            ["in/new.json", "folder/new.json"],
            ["out/", "out/depth.png"],
            ["out/", "out"],
            ["out/", "out/obstacles.json"],
        ] {
            let problem = files.problem(&[], &pair);
            assert!(problem.as_ref().is_some_and(|text| text.contains(" is both ")), "{pair:?}: {problem:?}");
        }
        assert_eq!(files.problem(&[], &["out/", "out/stats.json", "out/front.mcap"]), None);
    }

    #[test]
    fn nothing_is_added_to_a_folder_that_is_read() {
        let files = Files::new(&["in/a.png", "bag/run_0.mcap"]);
        assert_eq!(
            files.problem(&["in"], &["in/"]).unwrap(),
            "`in` is both the source and the folder of the results"
        );
        assert_eq!(
            files.problem(&["bag"], &["bag/front.mcap"]).unwrap(),
            "the output `bag/front.mcap` would be in `bag`, which is the source and is read as a whole"
        );
        assert!(files.problem(&["in"], &["in/new.mcap"]).is_some(), "the images would become a recording");
        assert_eq!(files.problem(&["in"], &["in/stats.json", "in/results/"]), None);
    }

    #[test]
    fn an_output_that_the_pattern_of_the_source_matches_is_refused() {
        let files = Files::new(&["in/a.png"]);
        let problem = |pattern: &str, output: &str| {
            let mut plan = FilePlan::default();
            plan.read_source("the source", &SourceName::parse(files.path(pattern).to_str().unwrap()));
            plan.write_results(&files.path(output));
            plan.check().err()
        };
        for (pattern, output) in
            [("in/*.png", "in/"), ("**/*.png", "in/results"), ("*/*/depth.png", "in/new")]
        {
            let error = problem(pattern, output);
            assert!(
                matches!(error, Some(FilePlanError::MatchesInput { .. })),
                "{pattern} {output}: {error:?}"
            );
        }
        for (pattern, output) in [("in/*.png", "in/results"), ("in/a*.png", "in"), ("in/*.png", "out")] {
            assert!(problem(pattern, output).is_none(), "{pattern} {output}");
        }
    }

    #[test]
    fn devices_may_be_written_twice() {
        let mut plan = FilePlan::default();
        plan.read("the source", "/dev/null");
        plan.write("one", "/dev/null");
        plan.write("other", "/dev/null");
        plan.check().unwrap();
    }
}
