//! Text files of one item a line, cut into pieces that threads read in parallel.

/// Approximate size of a piece, bytes.
const PIECE: usize = 1 << 20;

/// `text` in pieces of whole lines, in order.
pub fn pieces(text: &[u8]) -> Vec<&[u8]> {
    let mut pieces = Vec::with_capacity(text.len() / PIECE + 1);
    let mut rest = text;
    while rest.len() > PIECE {
        let end = rest[PIECE..].iter().position(|&byte| byte == b'\n').map_or(rest.len(), |at| PIECE + at + 1);
        let (piece, after) = rest.split_at(end);
        pieces.push(piece);
        rest = after;
    }
    if !rest.is_empty() {
        pieces.push(rest);
    }
    pieces
}

/// The lines of a piece, with their ends; the last may lack its own.
pub fn lines(piece: &[u8]) -> impl Iterator<Item = &[u8]> {
    piece.split_inclusive(|&byte| byte == b'\n')
}

/// The words of a line, separated by white space.
pub fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// A whole number of at most 18 digits. It takes a fraction of the time of [`number`].
pub fn integer(word: &[u8]) -> Option<i64> {
    let (sign, digits) = match word {
        [b'-', digits @ ..] => (-1, digits),
        [b'+', digits @ ..] => (1, digits),
        digits => (1, digits),
    };
    if !(1..=18).contains(&digits.len()) {
        return None;
    }
    let add = |sum: i64, byte: &u8| byte.is_ascii_digit().then(|| 10 * sum + i64::from(byte - b'0'));
    Some(sign * digits.iter().try_fold(0, add)?)
}

/// A number in Rust's notation.
pub fn number<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The next `N` numbers; more may follow.
pub fn numbers<'a, const N: usize>(words: &mut impl Iterator<Item = &'a [u8]>) -> Option<[f32; N]> {
    let mut values = [0.0; N];
    for value in &mut values {
        *value = number(words.next()?)?;
    }
    Some(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every line is in one piece, whole and in order, wherever the cuts fall and however the text ends.
    #[test]
    fn pieces_keep_lines() {
        for end in ["", "\n", "\r\n\n"] {
            let mut text: Vec<u8> = (0..300_000).flat_map(|i| format!("line {i}\n").into_bytes()).collect();
            text.extend(b"last");
            text.extend(end.as_bytes());
            let cut = pieces(&text);
            assert!(cut.len() > 3);
            assert_eq!(cut.concat(), text);
            assert!(cut[..cut.len() - 1].iter().all(|piece| piece.ends_with(b"\n")));
            let whole: Vec<&[u8]> = lines(&text).collect();
            assert_eq!(cut.iter().flat_map(|piece| lines(piece)).collect::<Vec<_>>(), whole);
        }
        assert!(pieces(b"").is_empty());
        assert_eq!(pieces(&vec![b'a'; 3 * PIECE]).len(), 1, "a line is not cut");
    }

    #[test]
    fn words_and_numbers() {
        assert_eq!(words(b" v\t1.5 \r\n").collect::<Vec<_>>(), [b"v".as_slice(), b"1.5"]);
        assert_eq!(numbers(&mut words(b"1.5 -2e3 x")), Some([1.5, -2000.0]));
        assert_eq!(numbers::<2>(&mut words(b"1.5")), None);
        assert_eq!(numbers::<1>(&mut words(b"\xff")), None);
        for (word, expected) in [("0", 0), ("-12", -12), ("+7", 7), ("999999999999999999", 999_999_999_999_999_999)] {
            assert_eq!(integer(word.as_bytes()), Some(expected));
        }
        for word in ["", "-", "1.", "x", "1000000000000000000", "--1"] {
            assert_eq!(integer(word.as_bytes()), None, "{word}");
        }
    }
}
