//! The daemon as a service: what it tells the service manager, and the units that start it.

use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use nix::sys::ptrace;
use nix::sys::wait::waitpid;
use nix::unistd::Pid;

use crate::support::Workbench;
use crate::support::daemon::{Daemon, FREE_PORTS};

/// What waits for something that has to happen waits so long.
const PATIENCE: Duration = Duration::from_secs(30);
/// The watchdog's period in these tests; it is fed four times in it.
const PERIOD: Duration = Duration::from_secs(2);

/// A service manager's socket.
struct Manager(UnixDatagram);

impl Manager {
    fn new(bench: &Workbench) -> Self {
        let socket = UnixDatagram::bind(bench.path("notify.sock")).expect("a socket");
        socket.set_read_timeout(Some(Duration::from_millis(50))).expect("a timeout");
        Self(socket)
    }

    /// The next message within a time.
    fn next(&self, within: Duration) -> Option<String> {
        let until = Instant::now() + within;
        let mut bytes = [0; 4096];
        while Instant::now() < until {
            if let Ok(length) = self.0.recv(&mut bytes) {
                return Some(String::from_utf8_lossy(&bytes[..length]).into_owned());
            }
        }
        None
    }

    /// Waits for a message that holds a text.
    fn wait_for(&self, text: &str) {
        let until = Instant::now() + PATIENCE;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let message = self.next(left).unwrap_or_else(|| panic!("the manager was not told {text}"));
            if message.contains(text) {
                return;
            }
        }
    }
}

fn start(bench: &Workbench, manager_is_here: bool) -> Daemon {
    bench.file("rig.toml", "kinect = []\n[[lidar]]\nid = \"front\"\n[record]\nmin_free = \"\"\n");
    let mut environment = vec![("WATCHDOG_USEC".into(), PERIOD.as_micros().to_string().into())];
    if manager_is_here {
        environment.push(("NOTIFY_SOCKET".into(), bench.path("notify.sock").into()));
    }
    let session = ["run", "--config", "rig.toml", "--record", "run.mcap", "--json", "--set", "stream.control="];
    Daemon::start_in(bench, &environment, &[&session[..], &FREE_PORTS].concat())
}

/// The core's thread of a process.
fn core_thread(process: u32) -> Pid {
    let threads = std::fs::read_dir(format!("/proc/{process}/task")).expect("it runs");
    let is_core = |path: &Path| std::fs::read_to_string(path.join("comm")).is_ok_and(|name| name.trim() == "core");
    let core = threads.filter_map(Result::ok).map(|entry| entry.path()).find(|path| is_core(path)).expect("a core");
    let number = core.file_name().and_then(|name| name.to_str()).expect("a number").parse().expect("a number");
    Pid::from_raw(number)
}

#[test]
fn ready_when_it_serves_the_watchdog_is_fed_by_the_core_alone_and_a_stop_leaves_a_whole_recording() {
    let bench = Workbench::new();
    let manager = Manager::new(&bench);
    let daemon = start(&bench, true);
    manager.wait_for("READY=1");
    // Ready means that clients are served.
    drop(std::net::TcpStream::connect(daemon.stream.expect("a stream")).expect("connects"));
    // Whose data are missing.
    manager.wait_for("front");
    manager.wait_for("WATCHDOG=1");

    // The core's thread is stopped, everything else runs: nobody feeds the watchdog in its stead.
    let core = core_thread(daemon.id());
    ptrace::attach(core).expect("a process may stop a thread of its child");
    waitpid(core, Some(nix::sys::wait::WaitPidFlag::__WALL)).expect("it stops");
    while manager.next(Duration::from_millis(100)).is_some() {}
    let until = Instant::now() + PERIOD;
    while let Some(message) = manager.next(until.saturating_duration_since(Instant::now())) {
        assert!(!message.contains("WATCHDOG"), "{message}");
    }
    ptrace::detach(core, None).expect("it goes on");
    manager.wait_for("WATCHDOG=1");

    let begun = Instant::now();
    daemon.signal("TERM");
    manager.wait_for("STOPPING=1");
    let ended = daemon.finish();
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(begun.elapsed() < Duration::from_secs(5), "the promise of docs/service.md: {:?}", begun.elapsed());
    let checked = bench.run(&["verify", "run.mcap"]);
    assert_eq!(checked.code, 0, "whole, and its replay is what it was: {}", checked.stderr);
}

#[test]
fn without_a_manager_nothing_is_missing() {
    let bench = Workbench::new();
    let daemon = start(&bench, false);
    daemon.signal("TERM");
    let ended = daemon.finish();
    assert_eq!(ended.code, Some(0), "{ended:?}");
}

/// The units as a package installs them.
fn staged(bench: &Workbench) {
    let systemd = Path::new(env!("CARGO_MANIFEST_DIR")).join("systemd");
    let units = bench.path("root/usr/lib/systemd/system");
    let programs = [bench.path("root/usr/bin"), bench.path("root/bin")];
    for folder in programs.iter().chain([&units]) {
        std::fs::create_dir_all(folder).expect("a folder");
    }
    for unit in ["tumbled.service", "tumbled-replay@.service"] {
        std::fs::copy(systemd.join(unit), units.join(unit)).expect("copies");
    }
    // What is started is only looked for; units of the system that are named exist there.
    std::fs::copy(env!("CARGO_BIN_EXE_tumbled"), bench.path("root/usr/bin/tumbled")).expect("copies");
    std::fs::copy("/bin/kill", bench.path("root/bin/kill")).expect("copies");
    for target in ["network-online", "multi-user", "sysinit", "basic", "shutdown"] {
        std::fs::write(units.join(format!("{target}.target")), "[Unit]\nDescription=Here\n").expect("writes");
    }
}

fn systemd_analyze(bench: &Workbench, arguments: &[&str]) -> Option<String> {
    let found = Command::new("systemd-analyze").current_dir(bench.path(".")).args(arguments).output();
    let Ok(output) = found else {
        println!("skipped: systemd-analyze is not on this machine");
        return None;
    };
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said).into_owned();
    assert!(output.status.success(), "{arguments:?}: {said}");
    Some(said)
}

#[test]
fn the_units_are_sound_and_may_do_no_more_than_they_need() {
    let bench = Workbench::new();
    staged(&bench);
    let root = format!("--root={}", bench.path("root").display());
    for unit in ["tumbled.service", "tumbled-replay@monday.service"] {
        let Some(said) = systemd_analyze(&bench, &["verify", &root, "--man=no", unit]) else { return };
        assert_eq!(said.trim(), "", "{unit}");
    }
    // 20 of 100: what stands free on the network has 92 to 96 (`systemd-analyze security`).
    for unit in ["tumbled.service", "tumbled-replay@.service"] {
        let file = format!("root/usr/lib/systemd/system/{unit}");
        let said = systemd_analyze(&bench, &["security", "--offline=true", "--threshold=20", "--no-pager", &file]);
        let exposure = said.as_deref().and_then(|said| said.lines().find(|line| line.contains("Overall")));
        println!("{unit}: {}", exposure.unwrap_or_default().trim());
    }
}

#[test]
fn a_package_unpacks_to_a_program_with_its_units_and_pages() {
    let bench = Workbench::new();
    if Command::new("dpkg-deb").arg("--version").output().is_err() {
        println!("skipped: dpkg-deb is not on this machine");
        return;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("systemd/package");
    let built = Command::new(script)
        .env("PACKAGE_COMPRESSION", "none")
        .arg(env!("CARGO_BIN_EXE_tumbled"))
        .arg(bench.path("."))
        .output()
        .expect("bash");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let package = String::from_utf8_lossy(&built.stdout).trim().to_owned();
    let root = bench.path("unpacked");
    let unpacked = Command::new("dpkg-deb").arg("-x").arg(&package).arg(&root).status().expect("dpkg-deb");
    assert!(unpacked.success());
    for file in [
        "usr/lib/systemd/system/tumbled.service",
        "usr/lib/systemd/system/tumbled-replay@.service",
        "usr/lib/sysusers.d/tumbled.conf",
        "usr/lib/tmpfiles.d/tumbled.conf",
        "usr/lib/sysctl.d/60-tumbled.conf",
        "usr/lib/udev/rules.d/51-tumbled.rules",
        "usr/share/man/man1/tumbled.1.gz",
        "usr/share/man/man1/tumbled-replay.1.gz",
        "usr/share/bash-completion/completions/tumbled",
        "usr/share/zsh/site-functions/_tumbled",
        "usr/share/fish/vendor_completions.d/tumbled.fish",
        "usr/share/doc/tumbled/rig.toml",
    ] {
        assert!(root.join(file).metadata().is_ok_and(|found| found.len() > 0), "{file}");
    }
    let said = Command::new(root.join("usr/bin/tumbled")).arg("--version").output().expect("it runs");
    assert!(String::from_utf8_lossy(&said.stdout).starts_with("tumbled "), "{said:?}");
    let fields = Command::new("dpkg-deb").args(["-f", &package, "Package", "Version"]).output().expect("dpkg-deb");
    let fields = String::from_utf8_lossy(&fields.stdout);
    assert!(fields.contains("Package: tumbled") && fields.contains(env!("CARGO_PKG_VERSION")), "{fields}");
}
