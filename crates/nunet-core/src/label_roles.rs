//! What a class of the segmentation means to a robot.

/// What a class of the segmentation means to a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Role {
    /// Can be driven on.
    Floor,
    /// Above every robot.
    Ceiling,
    /// Depth from one image is not reliable, because the surface is transparent or reflects.
    Deceptive,
    /// Everything else.
    Other,
}

const FLOOR: [&str; 8] = ["floor", "flooring", "ground", "rug", "carpet", "mat", "road", "sidewalk"];
const CEILING: [&str; 1] = ["ceiling"];
const DECEPTIVE: [&str; 10] =
    ["window", "windowpane", "glass", "mirror", "tv", "television", "screen", "monitor", "display", "water"];

impl Role {
    /// The role of a class by its name, such as `windowpane, window`: a list of synonyms.
    ///
    /// Any word makes a class deceptive (`glass door`), but only the last of a synonym makes it floor
    /// (`floor lamp`).
    fn of(name: &str) -> Self {
        let name = name.to_lowercase();
        let words = |text| str::split(text, |letter: char| !letter.is_alphanumeric());
        let has_last = |known: &[&str]| {
            name.split(',').filter_map(|synonym| words(synonym).next_back()).any(|word| known.contains(&word))
        };
        if words(&name).any(|word| DECEPTIVE.contains(&word)) {
            Self::Deceptive
        } else if has_last(&CEILING) {
            Self::Ceiling
        } else if has_last(&FLOOR) {
            Self::Floor
        } else {
            Self::Other
        }
    }
}

/// The role of every label.
#[derive(Debug, Clone)]
pub(crate) struct Roles {
    by_label: [Role; 256],
    /// Whether any class is floor. If not, floor is recognized by geometry alone.
    pub(crate) has_floor: bool,
}

impl Roles {
    /// From the names of the classes, index = label. Labels without a name, such as 255, are [`Role::Other`].
    pub(crate) fn new<S: AsRef<str>>(classes: &[S]) -> Self {
        let mut by_label = [Role::Other; 256];
        for (role, name) in by_label.iter_mut().zip(classes) {
            *role = Role::of(name.as_ref());
        }
        Self { by_label, has_floor: by_label.contains(&Role::Floor) }
    }

    pub(crate) fn of(&self, label: u8) -> Role {
        self.by_label[usize::from(label)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nunet_types::{NO_LABEL, NYU13_CLASSES};

    #[test]
    fn roles_follow_the_names_of_several_data_sets() {
        let roles = Roles::new(&NYU13_CLASSES);
        let named =
            |role| -> Vec<&str> { NYU13_CLASSES.into_iter().filter(|name| Role::of(name) == role).collect() };
        assert_eq!(named(Role::Floor), ["floor"]);
        assert_eq!(named(Role::Ceiling), ["ceiling"]);
        assert_eq!(named(Role::Deceptive), ["tv", "window"]);
        assert!(roles.has_floor && roles.of(NO_LABEL) == Role::Other);
        for (name, role) in [
            ("floor mat", Role::Floor),
            ("floor, flooring", Role::Floor),
            ("windowpane, window", Role::Deceptive),
            ("Glass_door", Role::Deceptive),
            ("crt screen", Role::Deceptive),
            ("floor lamp", Role::Other),
            ("glasses", Role::Other),
        ] {
            assert_eq!(Role::of(name), role, "{name}");
        }
    }

    #[test]
    fn a_list_without_a_floor_class_is_reported() {
        assert!(!Roles::new(&["wall", "chair"]).has_floor);
        assert!(!Roles::new::<&str>(&[]).has_floor);
    }
}
