//! Sees to a Vulkan driver on Linux: checks that the loader and a driver are installed, installs Mesa's on Debian and its
//! relatives, and says elsewhere what to install.
//!
//! Mesa's package includes the software driver *llvmpipe*, so that a machine without a GPU can run everything, slowly.

use std::collections::BTreeMap;
use std::env;
use std::ffi::OsString;
use std::fs;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::Command;

use thiserror::Error;

use crate::command_line;

/// What Debian and its relatives lack; the driver's package brings the loader as well.
const DEBIAN_PACKAGES: [&str; 2] = ["libvulkan1", "mesa-vulkan-drivers"];

/// Why there is still no driver.
#[derive(Debug, Error)]
pub(crate) enum DriverError {
    /// The package manager failed.
    #[error("`{command}` failed ({reason}); a Vulkan driver is needed: install mesa-vulkan-drivers as root")]
    Install { command: String, reason: String },
    /// The packages are there, the driver is not.
    #[error("mesa-vulkan-drivers was installed, but {0}; is there a Vulkan driver for this machine?")]
    StillMissing(Missing),
}

/// What keeps Vulkan from working.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub(crate) enum Missing {
    /// Without it no driver is ever looked for.
    #[error("the Vulkan loader libvulkan.so.1 is missing")]
    Loader,
    /// Drivers are known by small manifest files.
    #[error("no Vulkan driver is installed (there is no manifest in vulkan/icd.d)")]
    Driver,
    /// The user asks for a driver that is not there; installing another one would not help.
    #[error("{0} names no driver manifest; correct it or unset it")]
    ChosenDriver(&'static str),
}

/// Returns when a driver is there, or when this is a system on which only its user can install one; that is then told.
pub(crate) fn ensure() -> Result<(), DriverError> {
    if env::consts::OS != "linux" {
        return Ok(()); // Metal and Direct3D come with the system.
    }
    let Some(missing) = find_missing() else { return Ok(()) };
    if let Missing::ChosenDriver(_) = missing {
        eprintln!("warning: {missing}");
        return Ok(());
    }
    let system = System::read();
    if !system.is_debian() {
        // Perhaps the driver lies where we do not look: go on, and let the program say so if not.
        eprintln!("warning: {missing}. {}", system.advice());
        return Ok(());
    }
    eprintln!("{missing}: installing {}", DEBIAN_PACKAGES.join(" and "));
    install()?;
    find_missing().map_or(Ok(()), |missing| Err(DriverError::StillMissing(missing)))
}

fn find_missing() -> Option<Missing> {
    let variable = |name: &str| env::var_os(name);
    if !library_folders(variable, env::consts::ARCH).iter().any(|folder| folder.join("libvulkan.so.1").exists()) {
        return Some(Missing::Loader);
    }
    missing_driver(variable)
}

/// Looks for manifests where the Vulkan loader does (`LoaderDriverInterface.md` in its documentation).
fn missing_driver(variable: impl Fn(&str) -> Option<OsString>) -> Option<Missing> {
    for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        let chosen = paths(variable(name));
        if !chosen.is_empty() {
            return (!chosen.iter().any(|place| has_manifest(place))).then_some(Missing::ChosenDriver(name));
        }
    }
    (!manifest_places(variable).iter().any(|place| has_manifest(place))).then_some(Missing::Driver)
}

/// Where the dynamic linker finds libraries, as far as that can be known without asking it.
fn library_folders(variable: impl Fn(&str) -> Option<OsString>, architecture: &str) -> Vec<PathBuf> {
    let mut folders = paths(variable("LD_LIBRARY_PATH"));
    for root in ["/usr/local", "/usr", "/"].map(Path::new) {
        let library = root.join("lib");
        folders.extend([library.join(format!("{architecture}-linux-gnu")), root.join("lib64"), library]);
    }
    folders
}

/// The files and folders in which drivers' manifests can be, if the user does not choose some.
fn manifest_places(variable: impl Fn(&str) -> Option<OsString>) -> Vec<PathBuf> {
    let of_home = |below: &str| {
        let home = variable("HOME").filter(|home| !home.is_empty());
        home.map(|home| Path::new(&home).join(below).into_os_string())
    };
    let or = |name: &str, default: Option<OsString>| variable(name).filter(|value| !value.is_empty()).or(default);
    let folders = [
        or("XDG_CONFIG_HOME", of_home(".config")),
        or("XDG_CONFIG_DIRS", Some("/etc/xdg".into())),
        Some("/etc".into()),
        or("XDG_DATA_HOME", of_home(".local/share")),
        or("XDG_DATA_DIRS", Some("/usr/local/share:/usr/share".into())),
        // NixOS.
        Some("/run/opengl-driver/share".into()),
    ];
    let mut places = paths(variable("VK_ADD_DRIVER_FILES"));
    places.extend(folders.into_iter().flat_map(paths).map(|folder| folder.join("vulkan/icd.d")));
    places
}

/// The entries of a variable such as `PATH`.
fn paths(list: Option<OsString>) -> Vec<PathBuf> {
    env::split_paths(&list.unwrap_or_default()).filter(|path| !path.as_os_str().is_empty()).collect()
}

/// Whether a place is a manifest, or a folder with one.
fn has_manifest(place: &Path) -> bool {
    let is_manifest = |path: &Path| path.extension().is_some_and(|extension| extension == "json");
    if place.is_file() {
        return is_manifest(place);
    }
    fs::read_dir(place).is_ok_and(|entries| entries.flatten().any(|entry| is_manifest(&entry.path())))
}

/// What `/etc/os-release` says about this system.
#[derive(Debug, Default)]
struct System {
    /// Its own name, then those of its relatives, nearest first.
    names: Vec<String>,
    has_apt: bool,
}

impl System {
    fn read() -> Self {
        let text =
            ["/etc/os-release", "/usr/lib/os-release"].into_iter().find_map(|path| fs::read_to_string(path).ok());
        let path = env::var_os("PATH").unwrap_or_default();
        let has_apt = env::split_paths(&path).any(|folder| folder.join("apt-get").is_file());
        Self::parse(&text.unwrap_or_default(), has_apt)
    }

    fn parse(os_release: &str, has_apt: bool) -> Self {
        let unquote = |value: &str| value.trim().trim_matches(['"', '\'']).to_owned();
        let values: BTreeMap<&str, String> = os_release
            .lines()
            .filter_map(|line| line.trim().split_once('='))
            .map(|(key, value)| (key, unquote(value)))
            .collect();
        let names = ["ID", "ID_LIKE"].into_iter().filter_map(|key| values.get(key));
        Self { names: names.flat_map(|value| value.split_whitespace()).map(str::to_owned).collect(), has_apt }
    }

    fn is_debian(&self) -> bool {
        self.has_apt && self.names.iter().any(|name| matches!(name.as_str(), "debian" | "ubuntu"))
    }

    /// What its user can do.
    fn advice(&self) -> String {
        let command = self.names.iter().find_map(|name| match name.as_str() {
            "debian" | "ubuntu" => Some("apt-get install mesa-vulkan-drivers"),
            "fedora" | "rhel" | "centos" => Some("dnf install vulkan-loader mesa-vulkan-drivers"),
            "arch" => Some("pacman -S vulkan-icd-loader vulkan-swrast"),
            "suse" | "opensuse" => Some("zypper install libvulkan1 libvulkan_lvp"),
            "alpine" => Some("apk add vulkan-loader mesa-vulkan-swrast"),
            _ => None,
        });
        match command {
            Some(command) => format!("Install one: `{command}`, or the package of your GPU's maker."),
            None => "Install the Vulkan loader and a driver: Mesa's, or that of your GPU's maker.".to_owned(),
        }
    }
}

/// Installs [`DEBIAN_PACKAGES`], as root or through `sudo`.
fn install() -> Result<(), DriverError> {
    let is_root = is_root();
    let may_ask = io::stdin().is_terminal();
    // A stale package list is no reason to give up, if the packages are still where it says.
    if let Err(error) = run(apt(is_root, may_ask, &["update"])) {
        eprintln!("warning: {error}");
    }
    let packages = ["install", "--yes", "--no-upgrade", "--no-install-recommends"].into_iter().chain(DEBIAN_PACKAGES);
    run(apt(is_root, may_ask, &packages.collect::<Vec<_>>()))
}

/// `apt-get` with arguments. Through `sudo`, which asks for a password only if someone is there to answer.
fn apt(is_root: bool, may_ask: bool, arguments: &[&str]) -> Command {
    let mut words = match (is_root, may_ask) {
        (true, _) => vec![],
        (false, true) => vec!["sudo"],
        (false, false) => vec!["sudo", "-n"],
    };
    // Given on the line, because sudo drops the environment.
    words.extend(["env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-o", "DPkg::Lock::Timeout=120"]);
    let mut command = Command::new(words[0]);
    command.args(&words[1..]).args(arguments);
    command
}

fn run(mut command: Command) -> Result<(), DriverError> {
    let reason = match command.status() {
        Ok(status) if status.success() => return Ok(()),
        Ok(status) => status.to_string(),
        Err(error) => error.to_string(),
    };
    Err(DriverError::Install { command: command_line(&command), reason })
}

/// Asks `id`, as the standard library does not know.
fn is_root() -> bool {
    Command::new("id").arg("-u").output().is_ok_and(|output| output.stdout.trim_ascii() == b"0")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn system(os_release: &str) -> System {
        System::parse(os_release, true)
    }

    #[test]
    fn systems_are_told_apart() {
        assert!(
            system("PRETTY_NAME=\"Debian GNU/Linux 12 (bookworm)\"\nID=debian\nHOME_URL=\"https://x/?a=b\"\n")
                .is_debian()
        );
        assert!(system("ID=ubuntu\nID_LIKE=debian").is_debian());
        assert!(system("ID=linuxmint\r\nID_LIKE=\"ubuntu debian\"\r\n").is_debian());
        assert!(!System::parse("ID=debian", false).is_debian(), "without apt-get");
        for other in
            ["ID=fedora", "ID=\"opensuse-leap\"\nID_LIKE=\"suse opensuse\"", "NAME=debian", "VERSION_ID=debian", ""]
        {
            assert!(!system(other).is_debian(), "{other}");
        }
    }

    #[test]
    fn advice_fits_the_system() {
        for (os_release, word) in [
            ("ID=fedora", "dnf"),
            ("ID='rocky'\nID_LIKE='rhel centos fedora'", "dnf"),
            ("ID=manjaro\nID_LIKE=arch", "pacman"),
            ("ID=\"opensuse-leap\"\nID_LIKE=\"suse opensuse\"", "zypper"),
            ("ID=alpine", "apk"),
            ("ID=debian", "apt-get"),
            ("ID=plan9", "loader and a driver"),
        ] {
            assert!(system(os_release).advice().contains(word), "{os_release}");
        }
    }

    fn variables<'a>(set: &'a [(&str, &str)]) -> impl Fn(&str) -> Option<OsString> + 'a {
        |name| set.iter().find(|(key, _)| *key == name).map(|(_, value)| OsString::from(value))
    }

    #[cfg(unix)]
    #[test]
    fn manifests_are_looked_for_where_the_loader_does() {
        let found = manifest_places(variables(&[("HOME", "/home/me")]));
        for folder in ["/etc", "/usr/share", "/usr/local/share", "/home/me/.local/share", "/home/me/.config"] {
            assert!(found.contains(&Path::new(folder).join("vulkan/icd.d")), "{folder}");
        }
        let set = [("XDG_DATA_DIRS", "/a:/b"), ("XDG_DATA_HOME", "/c"), ("VK_ADD_DRIVER_FILES", "/d.json")];
        let found = manifest_places(variables(&set));
        for place in ["/a/vulkan/icd.d", "/b/vulkan/icd.d", "/c/vulkan/icd.d", "/d.json"] {
            assert!(found.contains(&PathBuf::from(place)), "{place}");
        }
        assert!(!found.contains(&PathBuf::from("/usr/share/vulkan/icd.d")));
    }

    #[test]
    fn a_chosen_driver_is_the_only_one() {
        let folder = tempfile::tempdir().unwrap();
        let (chosen, other) = (folder.path().join("chosen.json"), folder.path().join("vulkan/icd.d/other.json"));
        fs::create_dir_all(other.parent().unwrap()).unwrap();
        fs::write(&other, "{}").unwrap();
        let (chosen_path, folder_path) = (chosen.to_str().unwrap(), folder.path().to_str().unwrap());
        assert_eq!(missing_driver(variables(&[("XDG_DATA_DIRS", folder_path)])), None);
        for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
            let set = [("XDG_DATA_DIRS", folder_path), (name, chosen_path)];
            assert_eq!(missing_driver(variables(&set)), Some(Missing::ChosenDriver(name)));
            fs::write(&chosen, "{}").unwrap();
            assert_eq!(missing_driver(variables(&set)), None);
            fs::remove_file(&chosen).unwrap();
            assert_eq!(missing_driver(variables(&[("XDG_DATA_DIRS", folder_path), (name, "")])), None);
        }
    }

    #[test]
    fn a_place_counts_if_a_manifest_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("lvp_icd.x86_64.json");
        assert!(!has_manifest(folder.path()), "an empty folder");
        assert!(!has_manifest(&file), "a missing file");
        fs::write(folder.path().join("README"), "").unwrap();
        assert!(!has_manifest(folder.path()) && !has_manifest(&folder.path().join("README")));
        fs::write(&file, "{}").unwrap();
        assert!(has_manifest(folder.path()) && has_manifest(&file));
    }

    #[cfg(unix)]
    #[test]
    fn libraries_are_looked_for_where_the_linker_does() {
        let folders = library_folders(|name| (name == "LD_LIBRARY_PATH").then(|| "/opt/x::/opt/y".into()), "aarch64");
        for folder in ["/opt/x", "/opt/y", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/lib", "/usr/lib"] {
            assert!(folders.contains(&PathBuf::from(folder)), "{folder}");
        }
        assert!(folders.iter().all(|folder| folder.is_absolute()));
    }

    #[test]
    fn nobody_is_asked_where_nobody_is() {
        let line = |is_root, may_ask| command_line(&apt(is_root, may_ask, &["update"]));
        let apt_get = "env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=120 update";
        assert_eq!(line(true, true), apt_get);
        assert_eq!(line(false, true), format!("sudo {apt_get}"));
        assert_eq!(line(false, false), format!("sudo -n {apt_get}"));
    }
}
