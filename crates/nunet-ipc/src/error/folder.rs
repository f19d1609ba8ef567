//! Folders of iceoryx2 that this user may not use: the texts for them, whichever error carries them.

use std::path::Path;

use rustix::process::Uid;

/// The bits of a mode without those of the kind of file.
pub(crate) const PERMISSIONS: u32 = 0o7777;

/// Whether it is its own mode that keeps a user out of a folder of `uid`, as a umask of 0777 does. Modes do
/// not bind root.
pub(crate) fn is_closed_by_mode(uid: u32, mode: u32, user: Uid) -> bool {
    const OWNER_ALL: u32 = 0o700;
    !user.is_root() && uid == user.as_raw() && mode & OWNER_ALL != OWNER_ALL
}

/// A folder of this user, closed by its mode.
pub(super) fn closed(folder: &Path, mode: u32) -> String {
    format!("the mode of `{}` is {mode:03o}, expected at least 700", folder.display())
}

/// What opens a folder that its own mode closes.
pub(super) fn hint_for_closed(folder: &Path) -> String {
    let shown = folder.display();
    format!("run `chmod u+rwx {shown}`; if a new folder has this mode too, start with `umask 022`")
}

/// A folder that its user or its file system keeps from this user.
pub(super) fn no_access(folder: &Path, uid: u32) -> String {
    format!("this user may not use `{}`: it belongs to user {uid}", folder.display())
}
