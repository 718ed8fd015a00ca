//! Every command that the documents and the help show is one that `tvc` or `lab` takes: nothing is
//! run, each is parsed.

use std::fs;
use std::path::{Path, PathBuf};

use clap::{Command, CommandFactory};

use ground::cli::Cli;
use lab::Lab;

/// What stands between two commands of a line.
const BETWEEN: [&str; 4] = ["|", "&&", "||", ";"];
/// The programs whose lines are commands; of a block's other lines, what a command prints.
const PROGRAMS: [&str; 24] = [
    "apt-get",
    "chmod",
    "head",
    "rustup",
    "bossac",
    "brew",
    "cargo",
    "cd",
    "curl",
    "docker",
    "dot",
    "lab",
    "git",
    "mavproxy.py",
    "mkdir",
    "node",
    "npm",
    "openocd",
    "pip",
    "probe-rs",
    "python",
    "python3",
    "sudo",
    "tvc",
];
/// Folders of the tree with programs of its own.
const FOLDERS: [&str; 5] = [".ci/", "ground/", "python/", "samd21/", "tools/"];
/// Commands of cargo that the documents use besides the aliases.
const OF_CARGO: [&str; 12] = [
    "add", "build", "clippy", "deny", "doc", "embed", "fmt", "install", "package", "publish",
    "run", "test",
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The documents for users, by their paths from the root, and their texts.
fn documents() -> Vec<(String, String)> {
    let folders = ["docs", "docs/guides", "docs/explanation", "docs/reference"];
    let entries = folders.iter().flat_map(|folder| {
        let entries = fs::read_dir(root().join(folder)).unwrap();
        entries.map(move |entry| format!("{folder}/{}", entry.unwrap().file_name().display()))
    });
    let mut paths: Vec<String> = entries.filter(|path| path.ends_with(".md")).collect();
    paths.extend(["README.md", "CONTRIBUTING.md", "python/README.md"].map(str::to_owned));
    paths.sort();
    let read = |path: String| {
        let text = fs::read_to_string(root().join(&path)).unwrap();
        (path, text)
    };
    paths.into_iter().map(read).collect()
}

/// The fenced blocks of a document: their language and text.
fn blocks(text: &str) -> Vec<(&str, &str)> {
    let mut parts = text.split("```");
    let mut found = Vec::new();
    while let (Some(_), Some(block)) = (parts.next(), parts.next()) {
        found.push(block.split_once('\n').unwrap_or((block, "")));
    }
    found
}

/// The commands of a shell's line, in words.
fn commands(line: &str) -> Vec<Vec<String>> {
    let words = shlex::split(line).unwrap_or_else(|| panic!("no end of a quote: {line}"));
    let mut commands = vec![Vec::new()];
    let mut words = words.into_iter().peekable();
    while let Some(word) = words.next() {
        if BETWEEN.contains(&&*word) {
            commands.push(Vec::new());
        } else if matches!(&*word, ">" | ">>" | "<" | "2>") {
            // Its file.
            words.next();
        } else if word == "&" {
            commands.push(Vec::new());
        } else if let Some(command) = commands.last_mut() {
            command.push(word);
        }
    }
    for command in &mut commands {
        let first = command.iter().position(|word| !is_setting(word));
        command.drain(..first.unwrap_or(command.len()));
    }
    commands.retain(|command| !command.is_empty());
    commands
}

/// The program of this tree that a command starts, and what it is given.
fn of_tool<'a>(words: &[&'a str]) -> Option<(Command, Vec<&'a str>)> {
    let (tool, before) = match words[..] {
        ["cargo", "tvc", ..] => (Cli::command(), 2),
        ["cargo", "fly", ..] => (Cli::command(), 1),
        ["tvc", ..] => (Cli::command(), 1),
        ["cargo", "lab", ..] => (Lab::command(), 2),
        ["lab", ..] => (Lab::command(), 1),
        _ => return None,
    };
    Some((tool, words[before..].to_vec()))
}

/// Why a command of the tool cannot be parsed.
fn unparsed(tool: Command, given: &[&str]) -> Option<String> {
    let name = tool.get_name().to_owned();
    let words = [&[name.as_str()], given].concat();
    let error = tool.try_get_matches_from(words).err().filter(|error| error.use_stderr())?;
    Some(error.to_string().lines().next().unwrap_or_default().to_owned())
}

/// Why a command of another program cannot be meant.
fn impossible(command: &[String]) -> Option<String> {
    let program = &command[0];
    if program == "cargo" {
        let found = command.iter().skip(1).find(|word| !word.starts_with(['-', '+']));
        let found = found.map_or("", String::as_str);
        return (!OF_CARGO.contains(&found)).then(|| format!("cargo has no `{found}` here"));
    }
    // What is run out of the tree is there.
    let script = match program.as_str() {
        "python" | "python3" | "node" => {
            command.iter().skip(1).find(|word| word.ends_with(".py") || word.ends_with(".mjs"))?
        }
        _ => program,
    };
    let is_missing = is_in_tree(script) && !root().join(script).is_file();
    is_missing.then(|| format!("there is no {script}"))
}

/// Whether a line begins with a program, and not with what one prints.
fn is_command(line: &str) -> bool {
    let mut words = line.split(' ').skip_while(|word| is_setting(word));
    let first = words.next().unwrap_or_default();
    PROGRAMS.contains(&first) || is_in_tree(first)
}

/// Whether a word is a program of the source tree.
fn is_in_tree(word: &str) -> bool {
    FOLDERS.iter().any(|folder| word.starts_with(folder))
}

/// Whether a word sets a variable for the command behind it.
fn is_setting(word: &str) -> bool {
    let is_name = |name: &str| name.chars().all(|c| c.is_ascii_uppercase() || c == '_');
    word.split_once('=').is_some_and(|(name, _)| is_name(name))
}

/// What is wrong with a line of commands.
fn wrong(line: &str) -> Vec<String> {
    let check = |command: Vec<String>| {
        let words: Vec<&str> = command.iter().map(String::as_str).collect();
        match of_tool(&words) {
            Some((tool, given)) => unparsed(tool, &given),
            None => impossible(&command),
        }
    };
    let found = commands(line).into_iter().filter_map(check);
    found.map(|why| format!("{line}\n    {why}")).collect()
}

#[test]
fn every_command_of_the_documents_can_be_given() {
    let (mut seen, mut bad) = (0, Vec::new());
    for (path, text) in documents() {
        for (language, block) in blocks(&text) {
            if !["", "sh", "bash", "text"].contains(&language) {
                continue;
            }
            let joined = block.replace("\\\n", " ");
            for line in joined.lines() {
                // An indented line belongs to what a command prints.
                if line.starts_with(' ') || !is_command(line) {
                    continue;
                }
                seen += 1;
                bad.extend(wrong(line).into_iter().map(|why| format!("{path}: {why}")));
            }
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
    assert!(seen > 90, "{seen}");
}

#[test]
fn files_that_the_documents_show_can_be_read() {
    let mut seen = 0;
    for (path, text) in documents() {
        for (language, block) in blocks(&text) {
            let read = match language {
                "toml" => toml::from_str::<toml::Table>(block).err().map(|e| e.to_string()),
                "json" => {
                    serde_json::from_str::<serde_json::Value>(block).err().map(|e| e.to_string())
                }
                _ => continue,
            };
            seen += 1;
            assert_eq!(read, None, "{path}: {block}");
        }
    }
    assert!(seen > 0, "{seen}");
}

/// The command that the words begin with, and its parents' name.
fn command_of<'a>(words: &[&str], tool: &'a Command) -> &'a Command {
    let mut found = tool;
    for word in words {
        match found.find_subcommand(word) {
            Some(below) => found = below,
            None => break,
        }
    }
    found
}

/// A command within a sentence may leave values out, and still has only options that there are.
#[test]
fn every_option_that_is_named_in_a_sentence_is_there() {
    let (mut seen, mut bad) = (0, Vec::new());
    for (path, text) in documents() {
        let sentences: String = text.split("```").step_by(2).collect();
        for code in sentences.split('`').skip(1).step_by(2) {
            let words: Vec<&str> = code.split_whitespace().collect();
            let Some((mut tool, words)) = of_tool(&words) else {
                continue;
            };
            tool.build();
            let command = command_of(&words, &tool);
            if let [first, ..] = words[..]
                && command.get_name() == tool.get_name()
                && first.chars().all(|c| c.is_ascii_lowercase())
            {
                bad.push(format!("{path}: no command `{code}`"));
            }
            for word in words.iter().filter(|word| word.starts_with("--")) {
                let name = word[2..].split('=').next().unwrap_or_default();
                let mut options = command.get_arguments().filter_map(|option| option.get_long());
                let known = ["help", "version", "json"].contains(&name);
                seen += 1;
                if !known && !options.any(|option| option == name) {
                    bad.push(format!("{path}: no --{name} in `{code}`"));
                }
            }
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
    assert!(seen > 30, "{seen}");
}

/// The help of a command and of all below it, with its name.
fn helps(command: &Command, name: &str, found: &mut Vec<(String, String)>) {
    let help = command.get_after_help().or(command.get_after_long_help());
    found.extend(help.map(|help| (name.to_owned(), help.to_string())));
    for below in command.get_subcommands() {
        helps(below, &format!("{name} {}", below.get_name()), found);
    }
}

/// What a line says of its command stands two spaces behind it.
#[test]
fn every_example_of_the_help_can_be_given() {
    let mut all = Vec::new();
    helps(&Cli::command(), "tvc", &mut all);
    helps(&Lab::command(), "lab", &mut all);
    let (mut seen, mut bad) = (0, Vec::new());
    for (name, help) in all {
        let lines = help.lines().skip_while(|line| *line != "Examples:").skip(1);
        let lines = lines.take_while(|line| !line.is_empty());
        for line in lines.filter(|line| !line.starts_with("   ")) {
            let line = line.trim();
            let command = line.split("  ").next().unwrap_or_default();
            seen += 1;
            bad.extend(wrong(command).into_iter().map(|why| format!("{name}: {why}")));
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
    assert!(seen > 150, "{seen}");
}

#[test]
fn a_line_is_taken_apart_as_a_shell_does() {
    let line = "A=1 cargo tvc param list | jq '.a b' > x.json && tvc man ~/x   # then look";
    let expected =
        [vec!["cargo", "tvc", "param", "list"], vec!["jq", ".a b"], vec!["tvc", "man", "~/x"]];
    assert_eq!(commands(line), expected);
    assert!(wrong("cargo fly a chip").pop().is_some_and(|why| why.contains("unexpected")));
    assert!(wrong("cargo tvc fly --no-such").pop().is_some());
    assert!(wrong("python3 tools/none.py").pop().is_some());
    assert!(wrong("cargo tvv list").pop().is_some());
    assert!(wrong("cargo fly --seeds 4 # and so on").is_empty());
}
