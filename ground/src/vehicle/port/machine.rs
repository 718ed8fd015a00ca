//! What the machine says of a port: who may open it, and which programs have.

use std::path::Path;

use serde::Serialize;

/// Owner and rights of a device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Access {
    /// Its owner.
    pub owner: String,
    /// Its group.
    pub group: String,
    /// Rights of owner, group and others, three bits each.
    pub mode: u32,
    /// This program runs in the group.
    pub member: bool,
    /// Whoever runs it is listed in the group, which counts from the next login on.
    pub listed: bool,
}

/// A program that has a port open.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Program {
    /// Its process.
    pub id: u32,
    /// Its name.
    pub name: String,
}

impl Access {
    /// What to do if the port may not be opened.
    pub fn remedy(&self) -> String {
        let group = &self.group;
        if self.listed && !self.member {
            format!("you have joined its group {group} since you logged in: log in again")
        } else {
            format!(
                "it belongs to the group {group}: `sudo usermod -aG {group} $USER`, then log in again"
            )
        }
    }

    /// The rights as `ls` shows them.
    pub fn rights(&self) -> String {
        let letter = |bit: u32| match self.mode >> bit & 1 {
            0 => '-',
            _ => ['x', 'w', 'r'][bit as usize % 3],
        };
        (0..9).rev().map(letter).collect()
    }
}

/// Who owns a device, if the system tells.
#[cfg(all(unix, not(target_vendor = "apple")))]
pub fn access(device: &Path) -> Option<Access> {
    use std::os::unix::fs::MetadataExt;

    use nix::unistd::{Gid, Group, Uid, User, getegid, geteuid, getgroups};

    let meta = std::fs::metadata(device).ok()?;
    let gid = Gid::from_raw(meta.gid());
    let name = |id| Some(User::from_uid(id).ok()??.name);
    let group = Group::from_gid(gid).ok().flatten();
    let (group, members) =
        group.map_or((gid.to_string(), Vec::new()), |group| (group.name, group.mem));
    let user = name(geteuid());
    Some(Access {
        owner: name(Uid::from_raw(meta.uid())).unwrap_or_else(|| meta.uid().to_string()),
        group,
        mode: meta.mode() & 0o777,
        member: getegid() == gid || getgroups().unwrap_or_default().contains(&gid),
        listed: user.is_some_and(|user| members.contains(&user)),
    })
}

/// Nothing is known: on macOS and Windows a port belongs to no group.
#[cfg(not(all(unix, not(target_vendor = "apple"))))]
pub fn access(_device: &Path) -> Option<Access> {
    None
}

/// The other programs that have a device open, as far as whoever runs this may see; `None` where
/// the system does not tell.
pub fn holders(device: &Path) -> Option<Vec<Program>> {
    let device = std::fs::canonicalize(device).ok()?;
    let has_it = |process: &Path| {
        let open = std::fs::read_dir(process.join("fd")).into_iter().flatten();
        let links = open.flatten().map(|link| std::fs::read_link(link.path()));
        links.flatten().any(|path| path == device)
    };
    let own = std::process::id();
    let others = processes()?.into_iter().filter(|(id, _)| *id != own);
    let holders = others.filter(|(_, process)| has_it(process));
    Some(holders.map(|(id, process)| program(id, &process)).collect())
}

/// Names and processes of programs.
pub fn names(programs: &[Program]) -> String {
    let name = |program: &Program| format!("{} (process {})", program.name, program.id);
    match programs {
        [] => "no other program".into(),
        _ => programs.iter().map(name).collect::<Vec<_>>().join(", "),
    }
}

/// Who has a port open, and what to do about it; nothing if nobody has.
pub fn in_use(name: &str, holders: &[Program]) -> Option<String> {
    let is_held = !holders.is_empty();
    is_held.then(|| format!("{name} is in use by {}: end that first", names(holders)))
}

/// Whether a program of this name runs; `None` where the system does not tell.
pub fn is_running(name: &str) -> Option<bool> {
    let mut processes = processes()?.into_iter();
    Some(processes.any(|(id, process)| program(id, &process).name == name))
}

/// Every process and its folder, as Linux shows them.
fn processes() -> Option<Vec<(u32, std::path::PathBuf)>> {
    let entries = std::fs::read_dir("/proc").ok()?.flatten();
    let numbered = |entry: std::fs::DirEntry| {
        let id = entry.file_name().to_str()?.parse().ok()?;
        Some((id, entry.path()))
    };
    let processes: Vec<_> = entries.filter_map(numbered).collect();
    (!processes.is_empty()).then_some(processes)
}

fn program(id: u32, process: &Path) -> Program {
    let name = std::fs::read_to_string(process.join("comm")).unwrap_or_default();
    Program { id, name: name.trim().to_owned() }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::process::{Command, Stdio};

    #[test]
    fn rights_are_those_of_ls_and_a_new_group_needs_a_login() {
        let mut access = access(Path::new("/dev/null")).unwrap();
        assert_eq!((&*access.owner, &*access.rights()), ("root", "rw-rw-rw-"));
        access.group = "dialout".into();
        (access.listed, access.member) = (false, false);
        assert!(access.remedy().contains("usermod -aG dialout $USER"));
        access.listed = true;
        assert!(access.remedy().ends_with("log in again") && !access.remedy().contains("usermod"));
    }

    #[test]
    fn a_program_that_has_the_port_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("port");
        std::fs::write(&file, "").unwrap();
        assert_eq!(holders(&file), Some(Vec::new()));
        let mut other = Command::new("cat")
            .stdin(Stdio::piped())
            .stdout(std::fs::File::create(&file).unwrap())
            .spawn()
            .unwrap();
        let found = holders(&file).unwrap();
        other.kill().unwrap();
        other.wait().unwrap();
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].id, other.id());
    }
}
