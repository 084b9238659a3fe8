//! Refractive indices, by name or by what they reflect.

/// Refractive indices at 589 nm, most after Hecht, Optics.
const INDICES: [(&str, f32); 23] = [
    ("vacuum", 1.0),
    ("helium", 1.000036),
    ("hydrogen", 1.000132),
    ("air", 1.000277),
    ("carbon dioxide", 1.00045),
    ("water", 1.3330),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.52045),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.470),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.5750),
    ("diamond", 2.419),
];

/// The names that [`refractive_index`] knows.
pub const INDEX_NAMES: [&str; 23] = {
    let mut names = [""; 23];
    let mut i = 0;
    while i < names.len() {
        names[i] = INDICES[i].0;
        i += 1;
    }
    names
};

/// The refractive index of a medium.
pub fn refractive_index(name: &str) -> Option<f32> {
    let name = name.to_ascii_lowercase();
    INDICES.iter().find(|(known, _)| *known == name).map(|(_, index)| *index)
}

/// The refractive index whose reflectance at normal incidence is this one, below 1 (Fresnel's equations, solved for the index).
pub fn index_of(reflectance: f32) -> f32 {
    (1.0 + reflectance.sqrt()) / (1.0 - reflectance.sqrt())
}

/// Reflectance at normal incidence of a refractive index.
pub fn reflectance_of(index: f32) -> f32 {
    ((index - 1.0) / (index + 1.0)).powi(2)
}

/// eta and k of a metal in linear RGB; `none` reflects everything. Of a metal that was measured several times, which its name then tells
/// (`Cu_palik`, `Se-e`), one measurement stands for all.
pub fn conductor(name: &str) -> Option<([f32; 3], [f32; 3])> {
    let metal = |name: &str| name.trim_end_matches("_palik").trim_end_matches("-e").to_owned();
    let named = |name: &str| CONDUCTORS.iter().find(|(known, ..)| *known == name);
    let found = named(name).or_else(|| CONDUCTORS.iter().find(|(known, ..)| metal(known) == metal(name)));
    found.map(|(_, eta, k)| (*eta, *k))
}

/// The names that [`conductor`] knows.
pub fn conductor_names() -> Vec<&'static str> {
    CONDUCTORS.iter().map(|(name, ..)| *name).collect()
}

/// Name, eta, k: measured spectra turned into linear RGB the way Mitsuba 3 does in its RGB mode.
#[rustfmt::skip]
const CONDUCTORS: [(&str, [f32; 3], [f32; 3]); 38] = [
    ("none", [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
    ("Ag", [0.155276, 0.116728, 0.138388], [4.828354, 3.122222, 2.146901]),
    ("Al", [1.657501, 0.880405, 0.521244], [9.223811, 6.269502, 4.837004]),
    ("AlAs", [3.605296, 3.232938, 2.216319], [0.000679, 0.0, 0.007513]),
    ("AlSb", [0.0, 4.139375, 4.669254], [0.0, 0.094009, 1.30057]),
    ("Au", [0.143036, 0.375307, 1.442045], [3.982997, 2.385556, 1.603359]),
    ("Be", [4.185012, 3.185029, 2.784061], [3.835466, 3.010122, 2.868994]),
    ("Cr", [4.369668, 2.916505, 1.654905], [5.206547, 4.231306, 3.754699]),
    ("CsI", [2.1449, 1.702319, 1.662427], [0.0, 0.0, 0.0]),
    ("Cu", [0.201005, 0.92375, 1.102215], [3.913262, 2.453045, 2.14209]),
    ("Cu2O", [3.551773, 2.94987, 2.751875], [0.114207, 0.193897, 0.606134]),
    ("CuO", [3.247541, 2.447805, 2.21022], [0.52109, 0.570031, 0.722179]),
    ("Hg", [2.398939, 1.440028, 0.90957], [6.327587, 4.371925, 3.421764]),
    ("HgTe", [4.77904, 3.231196, 2.659901], [1.631613, 1.58081, 1.729287]),
    ("Ir", [3.0863, 2.082191, 1.617915], [5.592153, 4.067088, 3.267312]),
    ("K", [0.064043, 0.04641, 0.038185], [2.1042, 1.34894, 0.913126]),
    ("Li", [0.265791, 0.195618, 0.220949], [3.540155, 2.311123, 1.668607]),
    ("MgO", [2.089584, 1.650723, 1.594879], [0.0, 0.0, 0.0]),
    ("Mo", [4.483974, 3.525131, 2.77631], [4.111437, 3.420827, 3.150607]),
    ("Na_palik", [0.060269, 0.056141, 0.061988], [3.179273, 2.11249, 1.579041]),
    ("Nb", [3.420074, 2.790093, 2.395629], [3.441395, 2.737666, 2.579746]),
    ("Ni_palik", [2.367305, 1.663373, 1.467078], [4.498812, 3.050153, 2.345439]),
    ("Rh", [2.585793, 1.860216, 1.554263], [6.78226, 4.702987, 3.976073]),
    ("Se", [4.058311, 2.842935, 2.820853], [0.75405, 0.638444, 0.521808]),
    ("SiC", [3.172342, 2.525972, 2.479371], [1e-06, 0.0, 1e-05]),
    ("SnTe", [4.52425, 1.981645, 1.281591], [0.0, 0.0, 0.0]),
    ("Ta", [2.062721, 2.392939, 2.627929], [2.40836, 1.741486, 1.947028]),
    ("Te", [7.390234, 4.482105, 2.637106], [3.256022, 3.527059, 3.292054]),
    ("ThF4", [1.830714, 1.442229, 1.387648], [0.0, 0.0, 0.0]),
    ("TiC", [3.700528, 2.837422, 2.582287], [3.265635, 2.351589, 2.172791]),
    ("TiN", [1.64845, 1.150516, 1.379823], [3.368328, 1.943498, 1.102068]),
    ("TiO2", [3.45661, 2.801736, 2.905175], [0.000105, 0.0, 0.000653]),
    ("VC", [3.657566, 2.752736, 2.532672], [3.068301, 2.198687, 1.963193]),
    ("VN", [2.865602, 2.119189, 1.940091], [3.032243, 2.056116, 1.616306]),
    ("V_palik", [4.277582, 3.512949, 2.761071], [3.491301, 2.889455, 3.111522]),
    ("W", [4.370817, 3.300246, 2.998407], [3.500641, 2.604874, 2.273233]),
    ("a-C", [2.944046, 2.227136, 1.968162], [0.887465, 0.799299, 0.81529]),
    ("d-C", [2.70872, 2.318826, 2.228898], [0.0, 0.0, 0.0]),
];
