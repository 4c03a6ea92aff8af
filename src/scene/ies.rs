//! IES LM-63 files (1986, 1991, 1995, 2002, 2019) -> [`Profile`].
//!
//! Read here rather than by a crate: those that read the format are under the AGPL, or have no licence, turn candela into another
//! format's relative values, or lose the place of an error.

use super::profile::{Profile, Web};

/// Candela values of a file at the most; 181 x 361, one for each degree, are half as many.
const MOST_VALUES: usize = 1 << 17;
/// Lines before `TILT=` at the most.
const MOST_LINES: usize = 4096;
/// Bytes in which `TILT=` must begin for a file to be taken for one of these.
const HEAD: usize = 1 << 16;
/// Degrees by which written angles may miss what they mean.
const NEAR: f64 = 1e-3;

impl Profile {
    /// Whether bytes look like such a file. Pictures do not.
    pub fn is_ies(bytes: &[u8]) -> bool {
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let head = bytes.get(..HEAD).unwrap_or(bytes);
        bytes.starts_with(b"IES") || (!bytes.starts_with(b"#?") && head.windows(5).any(|word| word == b"TILT="))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// What is wrong in which line, and what to do about it.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let text = String::from_utf8_lossy(bytes);
        let (header, body) = split(&text)?;
        let mut words = Words::new(&text, body);
        if header.tilt {
            words.skip_tilt()?;
        }
        Measured::read(&mut words, header.has_lamp_factor)?.profile()
    }
}

/// What the lines before the numbers say.
struct Header {
    /// Factors by tilt follow.
    tilt: bool,
    /// The second factor is one on candela: until 1991. Later files have something else in its place.
    has_lamp_factor: bool,
}

/// The header, and the number of its last line (from 0).
fn split(text: &str) -> Result<(Header, usize), String> {
    let first = text.lines().next().unwrap_or_default().trim_start_matches('\u{feff}').trim();
    let is_later = ["LM-63-1995", "LM-63-2002", "LM-63-2019"].iter().any(|version| first.contains(version));
    for (index, line) in text.lines().take(MOST_LINES).enumerate() {
        let Some(tilt) = line.trim().strip_prefix("TILT=") else { continue };
        return Ok((Header { tilt: tilt.trim() == "INCLUDE", has_lamp_factor: !is_later }, index));
    }
    Err(format!(
        "no line begins with `TILT=` in the first {MOST_LINES}: this is no IES LM-63 file, or it is cut off; export it again"
    ))
}

/// The numbers of a file, with their lines.
struct Words<'a> {
    words: Box<dyn Iterator<Item = (usize, &'a str)> + 'a>,
    line: usize,
}

impl<'a> Words<'a> {
    /// Those behind a line.
    fn new(text: &'a str, line: usize) -> Self {
        let of_line = |(index, line): (usize, &'a str)| {
            line.split(|c: char| c.is_whitespace() || c == ',')
                .filter(|word| !word.is_empty())
                .map(move |word| (index + 1, word))
        };
        Self { words: Box::new(text.lines().enumerate().skip(line + 1).flat_map(of_line)), line: line + 1 }
    }

    fn number(&mut self, what: &str) -> Result<f64, String> {
        let Some((line, word)) = self.words.next() else {
            return Err(format!("the file ends after line {} where {what} should follow: is it cut off?", self.line));
        };
        self.line = line;
        let number = word.parse::<f64>().ok().filter(|number| number.is_finite());
        number.ok_or_else(|| {
            let word: String = word.chars().take(40).collect();
            format!("line {line}: `{word}` is no finite number, which {what} must be")
        })
    }

    fn count(&mut self, what: &str, least: usize) -> Result<usize, String> {
        let number = self.number(what)?;
        if number.fract() != 0.0 || number < least as f64 || number > MOST_VALUES as f64 {
            let line = self.line;
            return Err(format!(
                "line {line}: {what} is {number}, and must be a whole number from {least} to {MOST_VALUES}"
            ));
        }
        Ok(number as usize)
    }

    fn factor(&mut self, what: &str) -> Result<f64, String> {
        let number = self.number(what)?;
        if number < 0.0 {
            return Err(format!("line {}: {what} is {number}, and must not be negative", self.line));
        }
        Ok(number)
    }

    /// Ascending angles in degrees.
    fn angles(&mut self, count: usize, what: &str) -> Result<Vec<f64>, String> {
        let mut angles: Vec<f64> = Vec::with_capacity(count);
        for _ in 0..count {
            let angle = self.number(what)?;
            if angles.last().is_some_and(|last| angle - last < NEAR) {
                return Err(format!("line {}: {what} must ascend, and {angle} does not", self.line));
            }
            angles.push(angle);
        }
        Ok(angles)
    }

    /// Passes the lamp's factors by tilt: a light stands as its luminaire was measured.
    fn skip_tilt(&mut self) -> Result<(), String> {
        self.number("the lamp's position")?;
        let count = self.count("the number of angles of tilt", 0)?;
        (0..2 * count).try_for_each(|_| self.number("a tilt").map(drop))
    }
}

/// The table as the file has it.
struct Measured {
    kind: usize,
    vertical: Vec<f64>,
    horizontal: Vec<f64>,
    /// By horizontal angle.
    candela: Vec<Vec<f64>>,
}

impl Measured {
    fn read(words: &mut Words<'_>, has_lamp_factor: bool) -> Result<Self, String> {
        words.number("the number of lamps")?;
        words.number("lumens per lamp")?;
        let mut factor = words.factor("the multiplier of candela")?;
        let vertical = words.count("the number of vertical angles", 2)?;
        let horizontal = words.count("the number of horizontal angles", 1)?;
        if vertical * horizontal > MOST_VALUES {
            let line = words.line;
            return Err(format!(
                "line {line}: {vertical} x {horizontal} angles are more than the limit of {MOST_VALUES} values; \
                 thin them out"
            ));
        }
        let kind = words.count("the type of photometry", 1)?;
        if kind > 3 {
            return Err(format!("line {}: the type of photometry is 1 (C), 2 (B) or 3 (A), not {kind}", words.line));
        }
        for what in ["the type of units", "the width", "the length", "the height"] {
            words.number(what)?;
        }
        factor *= words.factor("the ballast factor")?;
        let lamp_factor = words.number("the number behind the ballast factor")?;
        if has_lamp_factor {
            factor *= lamp_factor.max(0.0);
        }
        words.number("the input watts")?;
        let vertical = words.angles(vertical, "a vertical angle")?;
        let horizontal = words.angles(horizontal, "a horizontal angle")?;
        let mut candela = Vec::with_capacity(horizontal.len());
        for _ in &horizontal {
            let value = |_: &f64| Ok(words.factor("a candela value")? * factor);
            candela.push(vertical.iter().map(value).collect::<Result<Vec<_>, String>>()?);
        }
        if !candela.iter().flatten().all(|value| (*value as f32).is_finite()) {
            return Err("candela times the file's factors are beyond what a 32-bit float holds".to_owned());
        }
        Ok(Self { kind, vertical, horizontal, candela })
    }

    /// The whole table: what symmetry leaves out is added.
    fn profile(self) -> Result<Profile, String> {
        match self.kind {
            1 => self.of_type_c(),
            kind => self.of_type_a_or_b(kind),
        }
    }

    fn of_type_c(mut self) -> Result<Profile, String> {
        within(&self.vertical, "vertical", [0.0, 180.0])?;
        within(&self.horizontal, "horizontal", [0.0, 360.0])?;
        let is = |angle: f64, other: f64| (angle - other).abs() < NEAR;
        let ends = [self.horizontal.first(), self.horizontal.last()].map(|angle| angle.copied().unwrap_or(0.0));
        match ends {
            _ if self.horizontal.len() == 1 => {
                self.horizontal = vec![0.0, 360.0];
                self.candela.extend_from_within(..);
            }
            // About the plane of 90 and 270 degrees (LM-63-1995).
            [first, last] if is(first, 90.0) && is(last, 270.0) => {
                self.mirror_columns(180.0, |angle| angle.abs() < 90.0 - NEAR);
                self.close_turn();
            }
            [first, last] if is(first, 0.0) && is(last, 90.0) => {
                self.mirror_columns(180.0, |angle| angle > 90.0 + NEAR);
                self.mirror_columns(360.0, |angle| angle > 180.0 + NEAR);
            }
            [first, last] if is(first, 0.0) && is(last, 180.0) => {
                self.mirror_columns(360.0, |angle| angle > 180.0 + NEAR);
            }
            [first, last] if is(first, 0.0) && is(last, 360.0) => {}
            [first, last] if is(first, 0.0) && last > 180.0 && 360.0 - last <= self.widest_step() + NEAR => {
                // Often the turn is not closed.
                self.close_turn();
            }
            [first, last] => {
                return Err(format!(
                    "the horizontal angles of type C go from {first} to {last} degrees, and must go from 0 to 0, 90, 180 or 360, or \
                     from 90 to 270"
                ));
            }
        }
        Ok(self.table(Web::Beam))
    }

    fn of_type_a_or_b(mut self, kind: usize) -> Result<Profile, String> {
        within(&self.vertical, "vertical", [-90.0, 90.0])?;
        within(&self.horizontal, "horizontal", [-90.0, 90.0])?;
        let starts = |angles: &[f64]| angles.first().is_some_and(|angle| angle.abs() < NEAR);
        if self.horizontal.len() == 1 {
            let angle = self.horizontal.first().copied().unwrap_or(0.0);
            return Err(format!(
                "there is one horizontal angle, {angle}: types A and B need several to say where light goes"
            ));
        }
        if starts(&self.horizontal) {
            self.mirror_columns(0.0, |angle| angle < -NEAR);
        }
        if starts(&self.vertical) {
            self.transpose();
            self.mirror_columns(0.0, |angle| angle < -NEAR);
            self.transpose();
        }
        let from_pole = |angle: &mut f64| *angle += 90.0;
        if kind == 2 {
            self.transpose();
            self.vertical.iter_mut().for_each(from_pole);
            Ok(self.table(Web::Side))
        } else {
            self.vertical.iter_mut().for_each(|angle| *angle = 90.0 - *angle);
            self.vertical.reverse();
            self.candela.iter_mut().for_each(|column| column.reverse());
            Ok(self.table(Web::Top))
        }
    }

    /// Adds the columns at `sum` less each horizontal angle, where that is one that is `lacking`.
    fn mirror_columns(&mut self, sum: f64, lacking: impl Fn(f64) -> bool) {
        let mirrored = self.horizontal.iter().zip(&self.candela).map(|(angle, column)| (sum - angle, column.clone()));
        let mut columns: Vec<(f64, Vec<f64>)> = mirrored.filter(|(angle, _)| lacking(*angle)).collect();
        columns.extend(std::mem::take(&mut self.horizontal).into_iter().zip(std::mem::take(&mut self.candela)));
        columns.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        (self.horizontal, self.candela) = columns.into_iter().unzip();
    }

    /// Ends a turn where it begins.
    fn close_turn(&mut self) {
        self.horizontal.extend(self.horizontal.first().map(|angle| angle + 360.0));
        self.candela.extend(self.candela.first().cloned());
    }

    /// Exchanges vertical and horizontal angles.
    fn transpose(&mut self) {
        let column = |row: usize| self.candela.iter().filter_map(|column| column.get(row).copied()).collect();
        self.candela = (0..self.vertical.len()).map(column).collect();
        std::mem::swap(&mut self.vertical, &mut self.horizontal);
    }

    fn widest_step(&self) -> f64 {
        self.horizontal.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
    }

    fn table(self, web: Web) -> Profile {
        let radians = |angles: Vec<f64>| angles.into_iter().map(|angle| angle.to_radians() as f32).collect();
        let candela: Vec<f32> = self.candela.into_iter().flatten().map(|value| value as f32).collect();
        let peak = candela.iter().copied().fold(0.0, f32::max);
        Profile { web, polar: radians(self.vertical), azimuth: radians(self.horizontal), candela, peak }
    }
}

fn within(angles: &[f64], what: &str, [least, most]: [f64; 2]) -> Result<(), String> {
    match angles.iter().find(|angle| **angle < least - NEAR || **angle > most + NEAR) {
        Some(angle) => {
            Err(format!("a {what} angle is {angle} degrees, and must lie between {least} and {most} in this type"))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A file of some type, angles and candela (by horizontal angle).
    fn file(kind: u32, vertical: &[f64], horizontal: &[f64], candela: impl Fn(f64, f64) -> f64) -> String {
        let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let columns = horizontal.iter().map(|h| list(&vertical.iter().map(|v| candela(*h, *v)).collect::<Vec<_>>()));
        let (rows, count) = (vertical.len(), horizontal.len());
        format!(
            "IESNA:LM-63-2002\r\n[TEST] none\r\nTILT=NONE\r\n1 -1 2 {rows} {count} {kind} 2 0 0 0\r\n0.5 1.1 60\r\n{}\r\n{}\r\n{}\r\n",
            list(vertical),
            list(horizontal),
            columns.collect::<Vec<_>>().join("\r\n")
        )
    }

    fn read(text: &str) -> Profile {
        Profile::read(text.as_bytes()).unwrap()
    }

    fn fault(text: &str) -> String {
        Profile::read(text.as_bytes()).unwrap_err()
    }

    /// In degrees, of a light as glTF has them.
    fn candela(profile: &Profile, direction: DVec3) -> f64 {
        profile.candela(DVec3::NEG_Z, DVec3::X, direction.normalize())
    }

    /// The direction at vertical and horizontal angles of type C.
    fn at(vertical: f64, horizontal: f64) -> DVec3 {
        let ((sin, cos), (side, ahead)) = (vertical.to_radians().sin_cos(), horizontal.to_radians().sin_cos());
        DVec3::new(sin * ahead, sin * side, -cos)
    }

    #[test]
    fn symmetric_tables_are_completed() {
        let verticals = [0.0, 30.0, 90.0];
        for (given, seen_at) in [
            (&[0.0][..], (|_| 0.0) as fn(f64) -> f64),
            (&[0.0, 45.0, 90.0], |h| if h > 180.0 { (360.0 - h).min(h - 180.0) } else { h.min(180.0 - h) }),
            (&[0.0, 90.0, 180.0], |h| if h > 180.0 { 360.0 - h } else { h }),
            (&[90.0, 135.0, 270.0], |h| {
                if h < 90.0 {
                    180.0 - h
                } else if h > 270.0 {
                    540.0 - h
                } else {
                    h
                }
            }),
            (&[0.0, 100.0, 200.0, 360.0], |h| h),
        ] {
            // Linear in both angles, but that a whole turn must be closed.
            let whole = *given.last().unwrap() == 360.0;
            let value = move |h: f64, v: f64| 1000.0 + v + if whole { (h % 360.0).min(200.0) } else { h };
            let profile = read(&file(1, &verticals, given, value));
            for (v, h) in [(10.0, 5.0), (60.0, 95.0), (30.0, 183.0), (89.0, 271.0), (45.0, 359.0)] {
                let mut expected = value(seen_at(h), v);
                if whole && h > 200.0 {
                    expected = 1000.0 + v + 200.0 * (360.0 - h) / 160.0;
                }
                let found = candela(&profile, at(v, h));
                assert!((found - expected).abs() < 1e-3, "{given:?} at {v}, {h}: {found} for {expected}");
            }
            assert_eq!(candela(&profile, DVec3::Z), 0.0, "nothing was measured there");
        }
    }

    #[test]
    fn an_open_turn_is_closed() {
        let profile = read(&file(1, &[0.0, 180.0], &[0.0, 90.0, 180.0, 270.0], |h, _| h));
        assert!((candela(&profile, at(90.0, 315.0)) - 135.0).abs() < 1e-3);
    }

    #[test]
    fn types_b_and_a_turn_about_their_own_poles() {
        let angles = [-90.0, -30.0, 0.0, 60.0, 90.0];
        let value = |h: f64, v: f64| 500.0 + h + 2.0 * v;
        // Side to side and up and down, by the definitions: B turns about the side's axis first, A about the vertical one.
        let b = |h: f64, v: f64| {
            let ((sh, ch), (sv, cv)) = (h.to_radians().sin_cos(), v.to_radians().sin_cos());
            DVec3::new(ch * sv, -sh, -ch * cv)
        };
        let a = |h: f64, v: f64| {
            let ((sh, ch), (sv, cv)) = (h.to_radians().sin_cos(), v.to_radians().sin_cos());
            DVec3::new(sv, -cv * sh, -cv * ch)
        };
        // Along B's pole and A's the mapping of angles to directions is not one to one: away from them.
        for (kind, direction) in [(2, &b as &dyn Fn(f64, f64) -> DVec3), (3, &a)] {
            let profile = read(&file(kind, &angles, &angles, value));
            for (h, v) in [(0.0, 0.0), (10.0, -45.0), (-70.0, 20.0), (80.0, 60.0)] {
                let found = candela(&profile, direction(h, v));
                assert!((found - value(h, v)).abs() < 1e-3, "type {kind} at {h}, {v}: {found}");
            }
            assert_eq!(candela(&profile, DVec3::new(0.1, 0.1, 1.0)), 0.0, "behind it");
            let half = read(&file(kind, &[0.0, 90.0], &[0.0, 90.0], |h, v| 500.0 + h + 2.0 * v));
            assert!((candela(&half, direction(-20.0, -30.0)) - 580.0).abs() < 1e-3, "symmetric both ways");
        }
    }

    #[test]
    fn a_uniform_profile_has_the_flux_of_a_point() {
        let profile = read(&file(1, &[0.0, 45.0, 180.0], &[0.0], |_, _| 3.0));
        assert!((profile.flux() - 4.0 * std::f64::consts::PI * 3.0).abs() < 1e-4);
        assert_eq!((profile.peak, profile.size()), (3.0, (2, 3)), "2 and 0.5 cancel; 1.1 says how the file was made");
        let halved = read(&file(1, &[0.0, 90.0], &[0.0], |_, _| 3.0));
        assert!((halved.flux() - 2.0 * std::f64::consts::PI * 3.0).abs() < 1e-4);
    }

    #[test]
    fn older_files_are_read() {
        let numbers = "1, 1000, 1.0,\n2 1 1 1 0 0 0\n1.0 0.5 100\n0 90\n0\n10 20\n";
        assert_eq!(read(&format!("LAMP BY NOBODY\nTILT=NONE\n{numbers}")).peak, 10.0, "a lamp's factor, until 1991");
        assert_eq!(read(&format!("IESNA91\n[X] y\nTILT=INCLUDE\n1\n2\n0 90\n1 0.8\n{numbers}")).peak, 10.0);
        assert_eq!(read(&format!("\u{feff}IESNA:LM-63-1995\n[X] \u{fffd}\nTILT=lamp.tlt\n{numbers}")).peak, 20.0);
    }

    #[test]
    fn faults_have_their_line_and_a_cure() {
        let good = file(1, &[0.0, 90.0], &[0.0], |_, _| 1.0);
        for (text, said) in [
            (String::new(), "no line begins with `TILT=`"),
            (good.replace("TILT=NONE", "TITL=NONE"), "no line begins with `TILT=`"),
            (good.replace("60", "sixty"), "line 5: `sixty` is no finite number"),
            (good.replace("60", "nan"), "line 5: `nan`"),
            (good.replace("0 90", "90 0"), "line 6: a vertical angle must ascend"),
            (good.replace("2 1 1 2", "2 1 4 2"), "line 4: the type of photometry is 1 (C), 2 (B) or 3 (A)"),
            (good.replace("2 1 1 2", "2.5 1 1 2"), "line 4: the number of vertical angles is 2.5"),
            (good.replace("2 1 1 2", "1 1 1 2"), "line 4: the number of vertical angles is 1"),
            (good.replace("2 1 1 2", "100000 100000 1 2"), "line 4: 100000 x 100000 angles"),
            (good.replace("2 1 1 2", "1e300 1 1 2"), "line 4: the number of vertical angles"),
            (good.replace("2 1 1 2", "2 2 1 2"), "the file ends after line 8 where a candela value should follow"),
            (good.replace("1 1\r\n", "1 -1\r\n"), "line 8: a candela value is -1"),
            (good.replace("1 1\r\n", "1 1e300\r\n"), "beyond what a 32-bit float holds"),
            (file(1, &[0.0, 181.0], &[0.0], |_, _| 1.0), "a vertical angle is 181 degrees"),
            (file(1, &[0.0, 90.0], &[0.0, 10.0], |_, _| 1.0), "go from 0 to 10 degrees"),
            (file(2, &[0.0, 90.0], &[0.0, 91.0], |_, _| 1.0), "a horizontal angle is 91 degrees"),
            (file(3, &[0.0, 90.0], &[0.0], |_, _| 1.0), "there is one horizontal angle"),
        ] {
            let found = fault(&text);
            assert!(found.contains(said), "{found}, and not {said}");
        }
        for end in 0..good.len() - 4 {
            assert!(Profile::read(&good.as_bytes()[..end]).is_err(), "cut off at {end}");
        }
    }

    #[test]
    fn damaged_files_are_sound_or_refused() {
        let mut state = 1_u64;
        let mut random = move |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below
        };
        let angles = [0.0, 20.0, 70.0, 90.0];
        let files = [1, 2, 3].map(|kind| file(kind, &angles, &angles, |h, v| h + v));
        let mut accepted = 0;
        for round in 0..3000 {
            let mut bytes = files[round % 3].clone().into_bytes();
            for _ in 0..=random(4) {
                let place = random(bytes.len());
                match random(3) {
                    0 => bytes[place] = b"0123456789.-e \n"[random(15)],
                    1 => drop(bytes.remove(place)),
                    _ => bytes.insert(place, b"0123456789.-e \n"[random(15)]),
                }
            }
            let Ok(profile) = Profile::read(&bytes) else { continue };
            accepted += 1;
            for list in [&profile.polar, &profile.azimuth] {
                assert!(list.len() >= 2 && list.windows(2).all(|pair| pair[0] < pair[1]), "{list:?}");
            }
            assert_eq!(profile.candela.len(), profile.polar.len() * profile.azimuth.len());
            assert!(
                profile.candela.iter().all(|candela| (0.0..=profile.peak).contains(candela))
                    && profile.peak.is_finite()
            );
            for direction in [DVec3::NEG_Z, DVec3::Z, DVec3::X, DVec3::NEG_Y, DVec3::ONE] {
                let found = candela(&profile, direction);
                assert!(found >= 0.0 && found <= f64::from(profile.peak) * 1.000_001);
            }
        }
        assert!(accepted > 100, "{accepted}");
    }

    #[test]
    fn files_are_told_from_pictures() {
        assert!(Profile::is_ies(file(1, &[0.0, 90.0], &[0.0], |_, _| 1.0).as_bytes()));
        assert!(Profile::is_ies(b"of old\nTILT=NONE\n") && Profile::is_ies(b"\xef\xbb\xbfIESNA91"));
        assert!(!Profile::is_ies(b"#?RADIANCE\nTILT=NONE") && !Profile::is_ies(b"\x89PNG") && !Profile::is_ies(b""));
    }
}
