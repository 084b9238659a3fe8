//! Good scene documents of other programs, to be damaged.

use crate::files;
use crate::gltf::{Document, rich};

/// Documents, and words of their format.
type Documents = (Vec<Vec<u8>>, &'static str);

/// Mitsuba's: one with many kinds of things, one of an old version, two with daylight, one that names what is not there.
pub fn xml() -> Documents {
    let body = r##"
        <bsdf type="principled" id="a"><rgb name="base_color" value="0.2 0.5 0.9"/><float name="roughness" value="0.3"/>
            <float name="metallic" value="0.4"/><float name="spec_tint" value="0.5"/><float name="sheen" value="1"/>
            <float name="clearcoat" value="0.7"/><float name="spec_trans" value="0.3"/><float name="flatness" value="0.2"/></bsdf>
        <bsdf type="mask" id="b"><float name="opacity" value="0.5"/><bsdf type="bumpmap">
            <texture type="bitmap"><string name="filename" value="grey.png"/><boolean name="raw" value="true"/></texture>
            <float name="scale" value="2"/><bsdf type="roughplastic"><float name="alpha" value="0.2"/></bsdf></bsdf></bsdf>
        <bsdf type="blendbsdf" id="c"><float name="weight" value="0.25"/><bsdf type="roughdielectric"/>
            <bsdf type="conductor"><string name="material" value="Cu"/></bsdf></bsdf>
        <shape type="shapegroup" id="g"><shape type="disk"/><shape type="cylinder"><float name="radius" value="0.5"/>
            <point name="p0" x="0" y="0" z="0"/><point name="p1" x="0" y="1" z="0"/></shape></shape>
        <shape type="instance"><ref id="g"/><transform name="to_world"><matrix value="1 0 0 1 0 1 0 0 0 0 1 0 0 0 0 1"/></transform></shape>
        <shape type="cube"><ref id="a"/><transform name="to_world"><lookat origin="0, 1, 6" target="0, 1, 0" up="0, 1, 0"/></transform></shape>
        <shape type="rectangle"><ref id="b"/><emitter type="area"><rgb name="radiance" value="#ffee10"/></emitter></shape>
        <shape type="sphere"><ref id="c"/><medium type="homogeneous" name="interior"><rgb name="sigma_t" value="1 2 3"/>
            <rgb name="albedo" value="0.9"/><phase type="hg"><float name="g" value="0.8"/></phase></medium></shape>
        <shape type="cube"><bsdf type="null"/></shape>
        <emitter type="constant"><spectrum name="radiance" value="400:1, 500:2, 600:3"/></emitter>
        <emitter type="point"><blackbody name="intensity" temperature="3000"/></emitter>"##;
    let old = files::xml_with(
        "<bsdf type='phong' id='p'><float name='exponent' value='50'/></bsdf>\
         <bsdf type='coating' id='q'><bsdf type='ward'/></bsdf><shape type='sphere'><ref id='p'/>\
         <transform name='toWorld'><rotate x='1' angle='-90'/></transform></shape>\
         <emitter type='envmap'><string name='filename' value='sky.exr'/><float name='scale' value='0.1'/></emitter>",
    )
    .replace("3.0.0", "0.5.0");
    let date = "<integer name='year' value='2010'/><integer name='month' value='7'/><float name='hour' value='9'/>\
         <float name='latitude' value='35'/><float name='turbidity' value='3'/>";
    let day = files::xml_with(&format!(
        "<emitter type='sunsky'>{date}<rgb name='albedo' value='0.1 0.2 0.3'/><float name='sun_aperture' value='2'/></emitter>"
    ));
    let old_day = files::xml_with(
        "<emitter type='sunsky'><vector name='sunDirection' x='-0.86' y='0.41' z='-0.27'/><float name='skyScale' value='6'/>\
         <float name='sunRadiusScale' value='18.8'/><boolean name='extend' value='true'/></emitter>",
    )
    .replace("3.0.0", "0.5.0");
    let left_behind = files::xml_with(
        "<bsdf type='diffuse' id='a'><default name='grey' value='0.5'/><rgb name='reflectance' value='$grey'/>\
         <float name='sheen' value='1'/></bsdf><shape type='sphere'><float name='radius' value='0'/><emitter type='area'/></shape>\
         <shape type='rectangle'><ref id='a'/><transform name='to_world'><scale x='0'/></transform></shape>\
         <shape type='cylinder'><float name='radius' value='0'/></shape><shape type='cube'><ref id='b'/></shape>\
         <shape type='obj'><string name='filename' value='lost.obj'/></shape>\
         <bsdf type='normalmap' id='b'><texture type='bitmap'><string name='filename' value='lost.png'/></texture>\
         <bsdf type='roughplastic'><texture type='bitmap' name='alpha'><string name='filename' value='lost.exr'/></texture></bsdf></bsdf>\
         <emitter type='envmap'><string name='filename' value='lost.hdr'/></emitter>",
    );
    let loose = files::xml_with(
        "<bsdf type='velvet' id='a'><rgb name='reflectance' value='0.5'/></bsdf><bsdf type='hair' id='h'/>\
         <bsdf type='principledthin' id='t'><float name='spec_trans' value='0.5'/><float name='diff_trans' value='1.5'/></bsdf>\
         <shape type='rectangle'><ref id='t'/></shape>\
         <bsdf type='mixturebsdf' id='m'><string name='weights' value='1 2 3'/><ref id='a'/><ref id='h'/><bsdf type='diffuse'/></bsdf>\
         <bsdf type='diffuse' id='v'><texture type='mesh_attribute' name='reflectance'><string name='name' value='vertex_color'/></texture></bsdf>\
         <shape type='obj'><string name='filename' value='tetrahedron.obj'/><ref id='v'/></shape><shape type='Cube'><ref id='m'/></shape>\
         <shape type='merge'><shape type='sphere'><animation name='toWorld'><transform time='0'><scale value='2'/></transform></animation></shape></shape>\
         <shape type='rectangle'><bsdf type='null'/><emitter type='area'><texture type='bitmap' name='radiance'><string name='filename' \
         value='grey.png'/></texture></emitter></shape><include filename='../a.xml'/><emitter type='collimated'/>\
         <emitter type='projector'><float name='fov' value='60'/><texture type='bitmap' name='irradiance'><string name='filename' \
         value='grey.png'/></texture></emitter><emitter type='spot'><texture type='checkerboard' name='texture'/></emitter>\
         <shape type='obj'><string name='filename' value='tetrahedron.obj'/><ref id='v' name='red'/><bsdf type='plastic' name='blue'/></shape>\
         <shape type='cube'><medium type='heterogeneous' name='interior'><string name='material' value='Coke'/>\
         <volume name='albedo' type='gridvolume'><string name='filename' value='lost.vol'/></volume></medium></shape>",
    );
    let seeds = vec![
        loose.clone().into(),
        loose.replace("3.0.0", "0.6.0").into(),
        files::XML.into(),
        files::xml_with(body).into(),
        old.into(),
        left_behind.into(),
        day.into(),
        old_day.into(),
    ];
    let tokens = "<scene> </scene> <!-- --> <![CDATA[ ]]> <!DOCTYPE <!ENTITY &amp; &lt; &#0; &#x10FFFF; $side $ <?xml ?> /> xmlns= \
        path volpath direct prb thindielectric diffuse roughconductor normalmap checkerboard scale uvscale perspective hdrfilm box \
        gaussian tent bilinear repeat mirror clamp nearest beckmann ggx wavelength uniform d65 irregular interior exterior isotropic";
    (seeds, tokens)
}

/// pbrt's: of v4 and of v3.
pub fn pbrt() -> Documents {
    let old = r#"Film "image" "float scale" 2 Renderer "sampler" SurfaceIntegrator "directlighting" TransformBegin TransformEnd
        LookAt 0 1 5 0 1 0 0 1 0 Camera "perspective" "float fov" 50 WorldBegin LightSource "infinite" "string mapname" "sky.exr"
        LightSource "infinite" "rgb L" [ .1 .2 .3 ] LightSource "goniometric" "string mapname" "grey.png"
        LightSource "projection" "string mapname" "grey.png" "float fov" 40 "float power" 3
        AttributeBegin AreaLightSource "diffuse" "string filename" "grey.png" "bool twosided" true Shape "disk" AttributeEnd
        Material "matte" "color Kd" [ .5 .4 .3 ] "float sigma" 20 Shape "sphere" Material "uber" "float Kt" .5 Shape "cone"
        Material "glass" "color Kt" [ .5 1 1 ] Shape "paraboloid" Material "substrate" Shape "hyperboloid"
        Material "disney" "float metallic" .4 Shape "trianglemesh" "point P" [ 0 0 0 1 0 0 0 1 0 ] "float st" [ 0 0 1 0 0 1 ]
        Material "metal" "blackbody eta" [ 3000 2 ] Shape "disk" "float innerradius" .2
        Material "translucent" Shape "loopsubdiv" "integer nlevels" 2 "point P" [ 0 0 0 1 0 0 0 1 0 ] "integer indices" [ 0 1 2 ]
        Material "plastic" Shape "plymesh" "string filename" "lost.ply" WorldEnd"#;
    let seeds = vec![files::PBRT.into(), old.into()];
    let tokens = "# [ ] \" \\ Import ActiveTransform EndTime All Transform Attribute \"shape\" \"light\" \"material\" 1e9 -1 nan 1e-40 \
        \"texture \"spectrum \"rgb \"blackbody \"xyz \"integer \"bool true false subsurface hair measured thindielectric \
        diffusetransmission power illuminance portal normalmap curve marble fbm bilerp dots ptex cropwindow realistic portal";
    (seeds, tokens)
}

/// glTF's, as text or binary: one with nearly everything, and one with what extensions add.
pub fn gltf(binary: bool) -> Documents {
    let mut other = rich();
    other.json["materials"][0]["extensions"] = serde_json::json!({
        "KHR_materials_transmission": { "transmissionFactor": 0.5 }, "KHR_materials_ior": { "ior": 1.4 },
        "KHR_materials_volume": { "thicknessFactor": 1.0, "attenuationDistance": 2.0, "attenuationColor": [1.0, 0.5, 0.25] },
        "KHR_materials_clearcoat": { "clearcoatFactor": 0.5 }, "KHR_materials_sheen": { "sheenColorFactor": [0.1, 0.2, 0.3] },
        "KHR_materials_emissive_strength": { "emissiveStrength": 2.0 }
    });
    let colors = other.floats(3, &[1., 0., 0., 0., 1., 0., 0., 0., 1., 1., 1., 1.]);
    other.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colors.into();
    other.json["meshes"][0]["primitives"][0]["mode"] = 5.into();
    other.json["extensions"] =
        serde_json::json!({ "KHR_lights_punctual": { "lights": [{ "type": "spot", "spot": {} }] } });
    other.json["nodes"][1]["extensions"] = serde_json::json!({ "KHR_lights_punctual": { "light": 0 } });
    let tokens = "{ } [ ] , : null true -1 4294967296 1e38 POSITION TEXCOORD_1 JOINTS_0 WEIGHTS_0 matrix rotation children skin sparse";
    let bytes = |document: Document| if binary { document.binary() } else { document.text().into_bytes() };
    ([rich(), other].map(bytes).into(), tokens)
}
