//! Measured media.

/// A medium as it was measured.
#[derive(Debug)]
pub struct Measured {
    /// Its name in scene files.
    pub name: &'static str,
    /// Scattering coefficient σ_s per channel, 1/mm; the reduced one where `cosine` is 0.
    pub scattering: [f32; 3],
    /// Absorption coefficient σ_a per channel, 1/mm.
    pub absorption: [f32; 3],
    /// Mean cosine of the scattering angle per channel.
    pub cosine: [f32; 3],
}

impl Measured {
    /// The mean cosine of all channels, each as often as light of it is scattered.
    pub fn mean_cosine(&self) -> f32 {
        let scattered: f32 = self.scattering.iter().sum();
        let sum: f32 = self.scattering.iter().zip(self.cosine).map(|(sigma, cosine)| sigma * cosine).sum();
        if scattered > 0.0 { sum / scattered } else { 0.0 }
    }

    /// Reduced scattering coefficient σ_s·(1 − g) per channel, 1/mm.
    pub fn reduced(&self) -> [f32; 3] {
        [0, 1, 2].map(|c| self.scattering[c] * (1.0 - self.cosine[c]))
    }
}

/// Extinction σ_t and albedo per channel, of absorption and scattering.
pub fn extinction([absorption, scattering]: [[f32; 3]; 2]) -> ([f32; 3], [f32; 3]) {
    let sum = [0, 1, 2].map(|c| absorption[c] + scattering[c]);
    let albedo = |c: usize| if sum[c] > 0.0 { scattering[c] / sum[c] } else { 0.0 };
    (sum, [0, 1, 2].map(albedo))
}

/// The measured medium of this name, in any case.
pub fn measured(name: &str) -> Option<&'static Measured> {
    MEASURED.iter().find(|medium| medium.name.eq_ignore_ascii_case(name))
}

const fn medium(name: &'static str, scattering: [f32; 3], absorption: [f32; 3], cosine: [f32; 3]) -> Measured {
    Measured { name, scattering, absorption, cosine }
}

/// The media of Jensen et al. 2001 (fig. 5, reduced scattering), and of Narasimhan et al. 2006.
pub const MEASURED: [Measured; 47] = [
    medium("Apple", [2.29, 2.39, 1.97], [0.003, 0.0034, 0.046], [0.0, 0.0, 0.0]),
    medium("Chicken1", [0.15, 0.21, 0.38], [0.015, 0.077, 0.19], [0.0, 0.0, 0.0]),
    medium("Chicken2", [0.19, 0.25, 0.32], [0.018, 0.088, 0.2], [0.0, 0.0, 0.0]),
    medium("Cream", [7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163], [0.0, 0.0, 0.0]),
    medium("Ketchup", [0.18, 0.07, 0.03], [0.061, 0.97, 1.45], [0.0, 0.0, 0.0]),
    medium("Marble", [2.19, 2.62, 3.0], [0.0021, 0.0041, 0.0071], [0.0, 0.0, 0.0]),
    medium("Potato", [0.68, 0.7, 0.55], [0.0024, 0.009, 0.12], [0.0, 0.0, 0.0]),
    medium("Skimmilk", [0.7, 1.22, 1.9], [0.0014, 0.0025, 0.0142], [0.0, 0.0, 0.0]),
    medium("Skin1", [0.74, 0.88, 1.01], [0.032, 0.17, 0.48], [0.0, 0.0, 0.0]),
    medium("Skin2", [1.09, 1.59, 1.79], [0.013, 0.07, 0.145], [0.0, 0.0, 0.0]),
    medium("Spectralon", [11.6, 20.4, 14.9], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    medium("Wholemilk", [2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014], [0.0, 0.0, 0.0]),
    medium("Lowfat Milk", [13.1157, 15.4445, 17.9572], [0.00287, 0.00575, 0.0115], [0.932, 0.902, 0.859]),
    medium("Reduced Milk", [13.7335, 15.6003, 17.8007], [0.00256, 0.00511, 0.01278], [0.819, 0.797, 0.746]),
    medium("Regular Milk", [18.2052, 20.3826, 22.3698], [0.00153, 0.0046, 0.01993], [0.75, 0.714, 0.681]),
    medium("Espresso", [7.78262, 8.1305, 8.53875], [4.79838, 6.57512, 8.84925], [0.907, 0.896, 0.88]),
    medium("Mint Mocha Coffee", [3.51133, 4.14383, 5.59667], [3.772, 5.82283, 7.82], [0.91, 0.907, 0.914]),
    medium("Lowfat Soy Milk", [2.03838, 2.32875, 3.90281], [0.00144, 0.00719, 0.03594], [0.85, 0.853, 0.842]),
    medium("Regular Soy Milk", [4.66325, 5.20183, 8.74575], [0.00192, 0.00958, 0.06517], [0.873, 0.858, 0.832]),
    medium("Lowfat Chocolate Milk", [9.8371, 11.4954, 13.1629], [0.0115, 0.0368, 0.1564], [0.934, 0.927, 0.916]),
    medium("Regular Chocolate Milk", [10.5685, 13.1416, 15.2202], [0.01006, 0.04313, 0.14375], [0.862, 0.838, 0.806]),
    medium("Coke", [0.00254, 0.00299, 0.0], [0.10014, 0.16503, 0.2468], [0.965, 0.972, 0.0]),
    medium("Pepsi", [0.00083, 0.00203, 0.0], [0.09164, 0.14158, 0.20729], [0.926, 0.979, 0.0]),
    medium("Sprite", [0.00011, 0.00014, 0.00014], [0.00189, 0.00183, 0.002], [0.943, 0.953, 0.952]),
    medium("Gatorade", [0.03668, 0.04488, 0.05742], [0.02479, 0.01929, 0.00888], [0.933, 0.933, 0.935]),
    medium("Chardonnay", [0.00021, 0.00033, 0.00048], [0.01078, 0.01186, 0.024], [0.914, 0.958, 0.975]),
    medium("White Zinfandel", [0.00022, 0.00033, 0.00046], [0.01207, 0.01618, 0.01984], [0.919, 0.943, 0.972]),
    medium("Merlot", [0.00081, 0.0, 0.0], [0.11632, 0.25191, 0.29434], [0.974, 0.0, 0.0]),
    medium("Budweiser Beer", [0.00029, 0.00055, 0.00059], [0.01149, 0.02491, 0.05779], [0.917, 0.956, 0.982]),
    medium("Coors Light Beer", [0.00062, 0.00127, 0.0], [0.00616, 0.01398, 0.03498], [0.918, 0.966, 0.0]),
    medium("Clorox", [0.02731, 0.03302, 0.03695], [0.00335, 0.01489, 0.0263], [0.912, 0.905, 0.892]),
    medium("Apple Juice", [0.00257, 0.00311, 0.00413], [0.01296, 0.02374, 0.05218], [0.947, 0.949, 0.945]),
    medium("Cranberry Juice", [0.00196, 0.00238, 0.00301], [0.03944, 0.09422, 0.12426], [0.947, 0.951, 0.974]),
    medium("Grape Juice", [0.00138, 0.0, 0.0], [0.10404, 0.23958, 0.29325], [0.961, 0.0, 0.0]),
    medium("Ruby Grapefruit Juice", [0.15496, 0.15391, 0.15995], [0.08587, 0.18314, 0.25262], [0.929, 0.929, 0.931]),
    medium("White Grapefruit Juice", [0.50499, 0.52742, 0.75282], [0.0138, 0.01883, 0.05678], [0.548, 0.545, 0.565]),
    medium("Shampoo", [0.00797, 0.00874, 0.01127], [0.01411, 0.04569, 0.06172], [0.91, 0.905, 0.92]),
    medium("Strawberry Shampoo", [0.00215, 0.00245, 0.00253], [0.01449, 0.05796, 0.07582], [0.927, 0.935, 0.994]),
    medium("Head & Shoulders Shampoo", [0.26747, 0.27696, 0.29574], [0.08462, 0.15688, 0.20365], [0.911, 0.896, 0.884]),
    medium("Lemon Tea Powder", [0.74489, 0.83823, 1.00158], [2.42881, 4.57573, 7.2127], [0.946, 0.946, 0.949]),
    medium("Orange Juice Powder", [0.00193, 0.00213, 0.00226], [0.00145, 0.00344, 0.00786], [0.919, 0.918, 0.922]),
    medium("Pink Lemonade Powder", [0.00123, 0.00133, 0.00131], [0.00116, 0.00237, 0.0032], [0.902, 0.902, 0.904]),
    medium("Cappuccino Powder", [12.2094, 16.4659, 29.2727], [35.8441, 49.547, 61.0844], [0.849, 0.843, 0.926]),
    medium("Salt Powder", [0.13805, 0.15677, 0.17865], [0.28415, 0.3257, 0.34148], [0.802, 0.793, 0.821]),
    medium("Sugar Powder", [0.00282, 0.00315, 0.00393], [0.01264, 0.03105, 0.05012], [0.921, 0.919, 0.931]),
    medium("Suisse Mocha Powder", [30.0848, 33.4452, 38.7191], [17.502, 27.0044, 35.4334], [0.907, 0.894, 0.888]),
    medium(
        "Pacific Ocean Surface Water",
        [0.0018, 0.00183, 0.00228],
        [0.03184, 0.03132, 0.03015],
        [0.902, 0.825, 0.914],
    ),
];
