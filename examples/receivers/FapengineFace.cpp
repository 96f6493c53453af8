// See FapengineFace.h.
#include "FapengineFace.h"

#include "Animation/MorphTarget.h"
#include "Engine/SkeletalMesh.h"
#include "GameFramework/Actor.h"
#include "Modules/ModuleManager.h"
#include "Serialization/JsonReader.h"
#include "Serialization/JsonSerializer.h"
#include "WebSocketsModule.h"

void UFapengineFace::BeginPlay()
{
    Super::BeginPlay();
    Face = GetOwner()->FindComponentByClass<USkeletalMeshComponent>();
    if (Face == nullptr || Face->GetSkeletalMeshAsset() == nullptr)
        return;
    for (UMorphTarget* Shape : Face->GetSkeletalMeshAsset()->GetMorphTargets())
        Shapes.Add(Key(Shape->GetName()), Shape->GetFName());
    Connect();
}

void UFapengineFace::EndPlay(const EEndPlayReason::Type Reason)
{
    if (Socket.IsValid()) { Socket->OnMessage().Clear(); Socket->OnClosed().Clear(); Socket->Close(); }
    Super::EndPlay(Reason);
}

void UFapengineFace::Connect()
{
    FModuleManager::LoadModuleChecked<FWebSocketsModule>(TEXT("WebSockets"));
    Socket = FWebSocketsModule::Get().CreateWebSocket(Address);
    TWeakObjectPtr<UFapengineFace> Weak(this);  // Unreal calls these on the game thread
    Socket->OnMessage().AddLambda([Weak](const FString& Text) { if (Weak.IsValid()) Weak->Newest = Text; });
    Socket->OnClosed().AddLambda([Weak](int32, const FString&, bool) { if (Weak.IsValid()) Weak->bLost = true; });
    Socket->OnConnectionError().AddLambda([Weak](const FString&) { if (Weak.IsValid()) Weak->bLost = true; });
    Socket->Connect();
}

void UFapengineFace::TickComponent(float Seconds, ELevelTick Type, FActorComponentTickFunction* Function)
{
    Super::TickComponent(Seconds, Type, Function);
    if (bLost)  // the server has gone: shut the mouth, and look for it again
    {
        bLost = false;
        WaitSeconds = 1.f;
        Newest.Empty();
        Rest();
    }
    if (WaitSeconds > 0.f && (WaitSeconds -= Seconds) <= 0.f)
        Connect();
    TSharedPtr<FJsonObject> Frame;
    if (!Newest.IsEmpty() && FJsonSerializer::Deserialize(TJsonReaderFactory<>::Create(Newest), Frame))
        Show(*Frame);
    Newest.Empty();
}

void UFapengineFace::Show(const FJsonObject& Frame)
{
    const TSharedPtr<FJsonObject>* Weights = nullptr;
    if (Frame.TryGetObjectField(bVisemes ? TEXT("visemes") : TEXT("arkit"), Weights))
        for (const auto& Weight : (*Weights)->Values)
            if (const FName* Shape = Shapes.Find(Key(FString(Weight.Key))))
                Face->SetMorphTarget(*Shape, static_cast<float>(Weight.Value->AsNumber()));
    const TArray<TSharedPtr<FJsonValue>>* Turn = nullptr;
    if (Frame.TryGetArrayField(TEXT("head"), Turn) && Turn->Num() == 3)  // down, the subject's left, right ear down
        Head = FRotator(-(*Turn)[0]->AsNumber(), -(*Turn)[1]->AsNumber(), (*Turn)[2]->AsNumber());
}

void UFapengineFace::Rest()
{
    for (const auto& Shape : Shapes)
        Face->SetMorphTarget(Shape.Value, 0.f);
    Head = FRotator::ZeroRotator;
}

FString UFapengineFace::Key(const FString& Name)
{
    FString Last = Name;
    Name.Split(TEXT("."), nullptr, &Last, ESearchCase::CaseSensitive, ESearchDir::FromEnd);
    if (Last.EndsWith(TEXT("_L"), ESearchCase::CaseSensitive)) Last = Last.LeftChop(2) + TEXT("Left");
    if (Last.EndsWith(TEXT("_R"), ESearchCase::CaseSensitive)) Last = Last.LeftChop(2) + TEXT("Right");
    return Last.ToLower().Replace(TEXT("viseme_"), TEXT("")).Replace(TEXT("_"), TEXT(""));
}
